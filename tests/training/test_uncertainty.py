"""Levels of uncertainty, and the plants that a plan is judged on within them."""

import numpy as np
import pytest

from app.planning.plant.spread import Spread
from app.planning.plant.system import Plant
from training.machines import RandomMachines
from training.uncertainty import MOST_DAMPING, NUM_PLANTS, RandomSpreads, plants_within

HORIZON = 64
RNG = np.random.default_rng(0)
TASKS = RandomMachines(stribeck_share=0.5).sample(200, HORIZON, RNG)
SPREADS = RandomSpreads().sample(200, RNG)


def columns(plants: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(Plant._fields, np.moveaxis(plants, 2, 0), strict=True))


def test_shares_lie_within_the_greatest_and_most_frictions_are_off_alike() -> None:
    most = RandomSpreads(friction=0.3, gain=0.05).most
    spreads = RandomSpreads(friction=0.3, gain=0.05).sample(2000, np.random.default_rng(1))

    assert most == Spread(0.3, 0.3, 0.3, 0.05)
    assert np.all((spreads >= 0) & (spreads <= most))
    np.testing.assert_allclose(spreads.mean(axis=0), np.array(most) / 2, rtol=0.1)
    assert np.mean(spreads[:, 0] == spreads[:, 1]) == pytest.approx(0.7, abs=0.05)


def test_a_machine_that_is_known_is_the_only_plant() -> None:
    np.testing.assert_array_equal(
        plants_within(TASKS, np.random.default_rng(0)), TASKS.plants[:, np.newaxis]
    )


def test_plants_are_off_by_their_shares_at_most_each_with_its_opposite() -> None:
    tasks = TASKS.with_spreads(SPREADS)
    plants = plants_within(tasks, np.random.default_rng(2))

    assert plants.shape == (200, NUM_PLANTS, len(Plant._fields))
    gain = Plant._fields.index("control_gain")
    off = plants[:, :, gain] / TASKS.plants[:, np.newaxis, gain] - 1.0
    assert np.all(np.abs(off) <= SPREADS[:, 3:] + 1e-12)
    np.testing.assert_allclose(off[:, : NUM_PLANTS // 2], -off[:, NUM_PLANTS // 2 :], atol=1e-12)
    np.testing.assert_array_equal(columns(plants)["bias"][:, 3], TASKS.plants[:, 9])


def test_all_plants_are_such_as_there_are() -> None:
    table = columns(plants_within(TASKS.with_spreads(SPREADS), np.random.default_rng(3)))

    assert np.all(table["damping_forward"] * table["time_step"] <= MOST_DAMPING + 1e-12)
    for way in ("forward", "backward"):
        static, coulomb = table[f"static_{way}"], table[f"coulomb_{way}"]
        assert np.all(static >= coulomb)
        weakens = table["stribeck_velocity"] > 0
        np.testing.assert_array_equal(table[f"breakaway_{way}"], np.where(weakens, static, coulomb))
