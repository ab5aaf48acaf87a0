from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from app.planning.plant.coverage import Coverage
from app.planning.plant.features import CHANGES, TASK_FEATURES, TaskFacts, feature_values
from app.planning.plant.machines import MACHINES, Machine
from app.planning.plant.natural_units import scales
from app.planning.plant.system import ByDirection, ControlLimits, System
from app.planning.plant.task import Task

PAPER = Coverage.only(System())
SLIPPERY = Coverage(
    PAPER.ranges
    | dict.fromkeys(
        ("coulomb_forward", "coulomb_backward", "breakaway_forward", "breakaway_backward"),
        (0.1, 0.6),
    )
)
GENERAL = Coverage(
    {
        "displacement_over_reach": (-1.98, 1.98),
        "target_velocity_over_speed": (-1.1, 1.1),
        "static_forward_over_limit": (0.02, 0.9),
        "static_backward_over_limit": (0.02, 0.9),
        "static_backward_over_forward": (0.5, 2.0),
        "coulomb_over_static_forward": (0.3, 1.0),
        "coulomb_over_static_backward": (0.3, 1.0),
        "damping_forward_times_horizon": (0.0, 40.0),
        "damping_backward_times_horizon": (0.0, 40.0),
        "bias_over_limit": (-0.2, 0.2),
        "velocity_threshold_over_step": (0.003, 0.1),
        "stribeck_over_step": (0.0, 10.0),
    }
)


def test_the_coverage_of_one_plant_covers_that_plant_alone() -> None:
    assert PAPER.covers(System(), 64)
    assert not PAPER.covers(System(static_friction=0.71), 64)


def test_a_range_covers_its_ends_and_what_lies_between() -> None:
    for friction, covered in ((0.1, True), (0.3, True), (0.6, True), (0.09, False), (0.61, False)):
        assert SLIPPERY.covers(System(coulomb_friction=friction), 64) is covered


@pytest.mark.parametrize(
    "part",
    [
        {"static_friction": ByDirection(0.7, 0.71)},
        {"coulomb_friction": ByDirection(0.6, 0.05)},
        {"viscous_damping": ByDirection(0.05, 0.06)},
        {"stribeck_velocity": 0.01},
        {"bias": 1e-6},
        {"control_gain": 2.0},
        {"control_limit": ControlLimits(-0.8, 0.9)},
        {"time_step": 0.04},
        {"velocity_threshold": 0.002},
    ],
)
def test_every_field_of_a_plant_counts(part: dict[str, Any]) -> None:
    system = replace(System(), **part)

    assert not PAPER.covers(system, 64)
    assert not SLIPPERY.covers(system, 64)
    assert Coverage.only(system).covers(system, 64)
    assert not Coverage.only(system).covers(System(), 64)


def test_the_same_friction_said_for_both_ways_is_the_same_plant() -> None:
    both_ways = System(
        ByDirection(0.7, 0.7), ByDirection(0.6, 0.6), control_limit=ControlLimits(-0.9, 0.9)
    )

    assert PAPER.covers(both_ways, 64)
    assert Coverage.only(both_ways) == PAPER


def test_plants_are_covered_by_what_has_no_unit() -> None:
    assert all(GENERAL.covers(machine.system, 64) for machine in MACHINES.values())
    # The same plant in cm, and with a motor of 100 of its units for each m/s^2.
    in_centimetres = System(
        70, 60, 0.05, control_limit=0.9, control_gain=100, velocity_threshold=0.1
    )
    assert GENERAL.covers(in_centimetres, 64)
    assert not GENERAL.covers(replace(System(), static_friction=0.82), 64)
    assert not GENERAL.covers(System(static_friction=0.7, coulomb_friction=0.2), 64)
    assert not GENERAL.covers(System(static_friction=0.0, coulomb_friction=0.0), 64)
    assert not GENERAL.covers(replace(System(), bias=0.19), 64)
    # Limits that are not about zero are as good as a bias.
    assert not GENERAL.covers(replace(System(), control_limit=ControlLimits(-0.5, 0.9)), 64)
    # 12.5 over a horizon of 64 steps, 50 over 256.
    damped = replace(System(), viscous_damping=12.5 / 3.2)
    assert GENERAL.covers(damped, 64)
    assert not GENERAL.covers(damped, 256)


@pytest.mark.parametrize("machine", MACHINES.values(), ids=list(MACHINES))
def test_a_task_beyond_the_ranges_is_taken_to_their_end(machine: Machine) -> None:
    plant = machine.system.plant
    reach, speed = scales(plant, 48)
    within = Task(0.3, 5 * speed, 0.3 + 1.9 * reach, -1.09 * speed, plant)
    beyond = Task(0.3, 5 * speed, 0.3 - 7 * reach, 1.2 * speed, plant)

    assert GENERAL.nearest(within, 48) == within
    nearest = GENERAL.nearest(beyond, 48)
    assert nearest[:4] == pytest.approx((0.3, 5 * speed, 0.3 - 1.98 * reach, 1.1 * speed))
    assert nearest.plant == plant
    names = ("displacement_over_reach", "target_velocity_over_speed")
    np.testing.assert_allclose(feature_values(names, nearest, 48), [[-1.98, 1.1]])


@pytest.mark.parametrize("name", CHANGES)
def test_every_feature_of_a_task_that_may_have_a_range_is_kept_within_it(name: str) -> None:
    coverage = Coverage({"static_forward": (0.0, 1.0), name: (0.25, 0.5)})
    for sign, end in ((1, 0.5), (-1, 0.25)):
        task = Task(100 * sign, 200 * sign, 400 * sign, 300 * sign, System().plant)
        nearest = coverage.nearest(task, 64)
        assert TASK_FEATURES[name](TaskFacts(nearest, 64)) == pytest.approx(end)
        assert sum(one != other for one, other in zip(task, nearest, strict=True)) == 1


def test_it_says_in_words_which_plants_it_covers() -> None:
    assert str(PAPER) == (
        "static_friction 0.7, coulomb_friction 0.6, viscous_damping 0.05, control_limit 0.9, "
        "time_step 0.05, velocity_threshold 0.001, the same both ways, without bias, gain or "
        "Stribeck effect"
    )
    assert str(GENERAL) == (
        "static friction 2 to 90 % of the limit, static friction backward 0.5 to 2 times that "
        "forward, Coulomb friction 30 to 100 % of static friction, viscous damping 0 to 40 over "
        "the horizon's duration, bias -20 to 20 % of the limit, velocity threshold 0.3 to 10 % of "
        "the velocity that full control adds in a step, Stribeck velocity 0 to 10 times the "
        "velocity that full control adds in a step"
    )
    assert "coulomb_friction 0.1 to 0.6, viscous_damping 0.05," in str(SLIPPERY)
    assert "same both ways" not in str(SLIPPERY)


def test_words_tell_what_a_real_machine_has_beside_the_papers_plant() -> None:
    emps = str(Coverage.only(MACHINES["emps"].system))
    assert "viscous_damping 1.752 forward, viscous_damping 2.527 backward, control_limit 10" in emps
    assert "control_gain 0.3694" in emps
    assert emps.endswith("without bias or Stribeck effect")

    rig = str(Coverage.only(MACHINES["rack_and_pinion"].system))
    assert "stribeck_velocity 0.0135" in rig
    assert rig.endswith("the same both ways, without bias or gain")

    pushed = str(Coverage.only(System(control_limit=ControlLimits(-0.5, 2))))
    assert "lowest_control -0.5, highest_control 2" in pushed


def test_it_travels_as_json() -> None:
    adapter = TypeAdapter(Coverage)
    assert adapter.validate_json(adapter.dump_json(SLIPPERY)) == SLIPPERY


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"static_forward": (0.6, 0.1)}, "static_forward is a range from 0.6 to 0.1"),
        ({"static_forward": (0.0, float("inf"))}, "static_forward is a range from 0.0 to inf"),
        ({"static_forward": (float("nan"), 1.0)}, "static_forward is a range from nan"),
        ({"mass": (0.0, 1.0)}, "no ranges of 'mass'"),
        ({"target_position": (0.0, 1.0)}, "which plants"),
        ({}, "which plants"),
    ],
)
def test_ranges_that_make_no_sense_are_refused(ranges: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Coverage(ranges)
