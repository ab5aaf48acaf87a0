"""Plants drawn around one, and the least error that they leave to any plan."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.plant.machines import MACHINES
from app.planning.plant.rollout import rollout
from app.planning.plant.system import Plant, System
from app.planning.problem import Problem
from app.planning.uncertainty.relative import Implausible, Relative

ALL = Relative(0.1, 0.2, 0.3, 0.15, 0.25, 0.05)
SERVO = System(1.2, 0.4, 2.7, stribeck_velocity=0.0135, bias=0.1, control_limit=9.0)


def columns(plants: FloatArray) -> dict[str, FloatArray]:
    return dict(zip(Plant._fields, plants.T, strict=True))


def test_each_parameter_is_spread_evenly_over_its_own_range() -> None:
    drawn = columns(ALL.draw(SERVO, 32, np.random.default_rng(0)))
    for name, share in (
        ("coulomb_forward", 0.2),
        ("damping_backward", 0.3),
        ("stribeck_velocity", 0.15),
        ("bias", 0.25),
        ("control_gain", 0.05),
    ):
        factors = drawn[name] / getattr(SERVO.plant, name)
        places = (factors - (1 - share)) / (2 * share)
        assert sorted(np.floor(places * 32)) == list(range(32))
        # Every fourth as well: these stand for all.
        assert sorted(np.floor(places[::4] * 8)) == list(range(8))
    for name in ("lowest_control", "highest_control", "time_step", "velocity_threshold"):
        assert set(drawn[name]) == {getattr(SERVO.plant, name)}
    for name in ("static", "coulomb", "damping"):
        np.testing.assert_allclose(drawn[f"{name}_forward"], drawn[f"{name}_backward"])


@pytest.mark.parametrize("system", [System(), SERVO, *(m.system for m in MACHINES.values())])
@pytest.mark.parametrize("count", [1, 7, 128])
def test_what_is_drawn_are_plants(system: System, count: int) -> None:
    relative = replace(ALL, coulomb_friction=0.5, viscous_damping=0.01)
    for plants in (
        relative.draw(system, count, np.random.default_rng(1)),
        relative.corners(system),
    ):
        drawn = columns(plants)
        for direction in ("forward", "backward"):
            static, coulomb = drawn[f"static_{direction}"], drawn[f"coulomb_{direction}"]
            assert np.all(static >= coulomb)
            weakens = system.stribeck_velocity is not None
            breakaway = drawn[f"breakaway_{direction}"]
            np.testing.assert_array_equal(breakaway, static if weakens else coulomb)
            assert np.all(drawn[f"damping_{direction}"] * drawn["time_step"] < 1)
        assert np.all(plants[:, -5] > 0)


def test_any_two_parameters_are_off_in_all_four_ways_at_the_corners() -> None:
    drawn = columns(ALL.corners(SERVO))
    names = ("static_forward", "coulomb_forward", "damping_forward", "bias", "control_gain")
    ends = {name: drawn[name] > getattr(SERVO.plant, name) for name in names}
    for one in names:
        np.testing.assert_allclose(
            np.abs(drawn[one] / getattr(SERVO.plant, one) - 1),
            {"static_forward": 0.1, "coulomb_forward": 0.2, "damping_forward": 0.3}.get(
                one, 0.25 if one == "bias" else 0.05
            ),
        )
        for other in names:
            if one != other:
                assert len(set(zip(ends[one], ends[other], strict=True))) == 4


def test_damping_that_no_plant_can_have_is_refused() -> None:
    with pytest.raises(Implausible, match="viscous_damping") as refused:
        Relative(viscous_damping=0.5).draw(System(viscous_damping=15.0), 4, np.random.default_rng())
    assert refused.value.parameter == "viscous_damping"


@pytest.mark.parametrize("share", [-0.1, 0.95, math.nan, math.inf])
def test_a_share_is_one(share: float) -> None:
    with pytest.raises(ValueError, match="control_gain"):
        Relative(control_gain=share)


def test_the_sensitivities_of_any_motion_add_up_to_its_displacement() -> None:
    # What the bound rests on, with damping and bias: by central differences.
    system = System(0.7, 0.6, 0.4, bias=0.05)
    controls = np.repeat([0.9, -0.9, -0.3, 0.9, 0.0], [12, 9, 8, 5, 30])[np.newaxis]

    def displacement(**factors: float) -> float:
        changed = {name: getattr(system, name) * factor for name, factor in factors.items()}
        return float(rollout(replace(system, **changed), np.zeros(2), controls)[0, -1, 0])

    rest = rollout(system, np.zeros(2), controls)[0, -1]
    assert rest[1] == 0.0
    small = 1e-5
    total = sum(
        (displacement(**{name: 1 + small}) - displacement(**{name: 1 - small})) / (2 * small)
        for name in ("static_friction", "coulomb_friction", "bias", "control_gain")
    )
    assert total == pytest.approx(rest[0], rel=1e-4)


def test_the_least_error_is_that_of_friction_and_gain_weighed_against_each_other() -> None:
    def bound(relative: Relative, system: System | None = None, v: float = 0.0) -> float | None:
        problem = Problem(np.array([0.1, 0.0]), np.array([-0.3, v]), system or System())
        return relative.least_rms_error(problem)

    friction_and_gain = Relative(static_friction=0.3, coulomb_friction=0.1, control_gain=0.05)
    assert bound(friction_and_gain) == pytest.approx(0.4 * 0.0258199, rel=1e-4)
    assert bound(Relative(coulomb_friction=0.1)) == 0.0
    # A bias that is certain can be pushed against; one that is not counts like the gain.
    assert bound(friction_and_gain, System(bias=0.1)) == 0.0
    with_bias = replace(friction_and_gain, bias=0.05)
    expected = 0.4 / math.sqrt(3 / 0.1**2 + 2 * 3 / 0.05**2)
    assert bound(with_bias, System(bias=0.1)) == pytest.approx(expected)
    assert bound(Relative(control_gain=0.05), System(0.0, 0.0)) == pytest.approx(
        0.4 * 0.05 / 3**0.5
    )
    assert bound(friction_and_gain, v=0.1) is None
    assert bound(friction_and_gain, System(stribeck_velocity=0.1)) is None
