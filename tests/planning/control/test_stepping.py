"""When a mass is held, and what a step says of itself."""

from dataclasses import replace

import numpy as np
import pytest

from app.planning.control import RecedingHorizon
from app.planning.control.memory import Memory
from app.planning.control.observer import Observer
from app.planning.control.simulation import Sensor
from app.planning.control.step import STATUSES, Goal, Measurement, Status, control_step
from app.planning.plant.system import System
from tests.planning.control.controllers import run

LOOKING = RecedingHorizon(observer=Observer(1e-4, 1e-2), dead_band=3e-4)
ARRIVED = STATUSES.index("arrived")


@pytest.mark.parametrize("measures_velocity", [True, False])
@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_a_mass_that_has_arrived_stays_so_whatever_a_noisy_sensor_says(
    noise: float, measures_velocity: bool
) -> None:
    looking = RecedingHorizon(observer=Observer(noise))
    sensor = Sensor(noise, 1e-2, measures_velocity=measures_velocity)
    runs = run(looking, sensor=sensor, steps=300, seeds=10)
    first = np.argmax(runs.statuses == ARRIVED, axis=1)

    assert np.all(first < 110)
    assert np.all(runs.statuses[:, 150:] == ARRIVED)


def steps_at(
    error: float, count: int, memory: Memory | None = None, target: float = 0.3
) -> tuple[list[Status], Memory]:
    """Return the statuses of as many steps at rest so far (m) from the target, and the memory."""
    statuses: list[Status] = []
    for _ in range(count):
        measurement = Measurement(0.3 + error, 0.0)
        taken = control_step(LOOKING, System(), measurement, Goal(target), memory)
        memory = taken.memory
        statuses.append(taken.status)
    assert memory is not None
    return statuses, memory


def test_it_is_held_until_it_is_outside_of_the_dead_band_for_certain() -> None:
    held, memory = steps_at(2e-4, 10)
    at_the_edge, memory = steps_at(3.5e-4, 20, memory)
    outside, _ = steps_at(7e-4, 20, memory)

    assert set(held) == {"arrived"}
    assert set(at_the_edge) == {"arrived"}
    assert outside[-1] != "arrived"


def test_what_was_never_in_the_dead_band_has_not_arrived() -> None:
    assert "arrived" not in steps_at(3.5e-4, 20)[0]


def test_another_target_is_another_dead_band() -> None:
    _, memory = steps_at(0.0, 10)

    assert steps_at(0.0, 1, memory, target=0.3003501)[0] == ["moving"]


def test_a_held_mass_that_is_pushed_away_moves_at_once() -> None:
    _, memory = steps_at(0.0, 10)
    pushed = control_step(LOOKING, System(), Measurement(0.3025, 0.05), Goal(0.3), memory)

    assert pushed.status == "moving"
    assert pushed.control < 0.0


def test_an_exact_state_is_held_in_the_dead_band_and_not_beyond() -> None:
    exact = replace(LOOKING, observer=None)
    inside = control_step(exact, System(), Measurement(0.3002, 0.0), Goal(0.3))
    beyond = control_step(exact, System(), Measurement(0.30031, 0.0), Goal(0.3), inside.memory)

    assert inside.status == "arrived"
    assert beyond.status != "arrived"


@pytest.mark.parametrize("target", [1.2e-3, 2.7e-3, 5.2e-3])
def test_what_is_to_arrive_as_early_as_can_be_waits_for_nothing(target: float) -> None:
    # A plan that begins with rest would begin with it in the next step, too, and for ever.
    sticky = System(0.84, 0.6)
    early, later = (
        control_step(RecedingHorizon(observer=None), sticky, Measurement(0.0, 0.0), goal)
        for goal in (Goal(target), Goal(target, 40))
    )

    assert early.predicted_states[1, 1] > 0.0
    assert early.status == "moving"
    assert len(later.plan) == 40
