"""The plant's parameters: which ones are possible, and the paper's."""

import math
from typing import Any

import pytest

from app.planning.plant.system import ByDirection, ControlLimits, Plant, System


@pytest.mark.parametrize(
    ("parameters", "named"),
    [
        ({"static_friction": -0.1, "coulomb_friction": -0.2}, "static_friction"),
        ({"coulomb_friction": -0.1}, "coulomb_friction"),
        ({"viscous_damping": -0.1}, "viscous_damping"),
        ({"control_limit": 0.0}, "control_limit"),
        ({"time_step": 0.0}, "time_step"),
        ({"velocity_threshold": 0.0}, "velocity_threshold"),
        ({"coulomb_friction": 0.71}, "coulomb_friction must not exceed static_friction"),
        ({"viscous_damping": 20.0}, "viscous_damping"),
        (
            {"coulomb_friction": ByDirection(0.1, 0.71)},
            "coulomb_friction must not exceed static_friction backward",
        ),
        (
            {"static_friction": ByDirection(0.5, 0.8)},
            "coulomb_friction must not exceed static_friction forward",
        ),
        ({"viscous_damping": ByDirection(20.0, 0.1)}, "viscous_damping .* forward"),
        ({"control_gain": 0.0}, "control_gain"),
        ({"control_gain": -1.0}, "control_gain"),
        ({"stribeck_velocity": 0.0}, "stribeck_velocity"),
        ({"bias": 2e6}, "bias"),
        *(
            ({name: value}, name)
            for name in System.__dataclass_fields__
            for value in (math.nan, math.inf, -math.inf)
        ),
    ],
)
def test_an_impossible_plant_is_refused_by_the_name_of_its_parameter(
    parameters: dict[str, Any], named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        System(**parameters)


def test_the_limits_of_what_is_possible_are_accepted() -> None:
    System(static_friction=0.0, coulomb_friction=0.0, viscous_damping=0.0)
    System(static_friction=0.6, coulomb_friction=0.6)
    System(viscous_damping=19.99)
    System(control_limit=ControlLimits(0.1, 0.2), bias=-5.0)


@pytest.mark.parametrize(("lower", "upper"), [(1.0, 1.0), (0.5, -0.5), (math.nan, 1.0), (0.0, 2e6)])
def test_limits_the_wrong_way_round_are_refused(lower: float, upper: float) -> None:
    with pytest.raises(ValueError, match=r"lower|upper"):
        ControlLimits(lower, upper)


@pytest.mark.parametrize("forward", [-0.1, math.nan, math.inf])
def test_no_friction_drives(forward: float) -> None:
    with pytest.raises(ValueError, match="forward"):
        ByDirection(forward, 0.1)


def test_a_plant_that_differs_by_direction_says_so_in_every_parameter() -> None:
    system = System(
        static_friction=ByDirection(0.7, 0.5),
        coulomb_friction=ByDirection(0.6, 0.4),
        viscous_damping=ByDirection(1.7, 2.5),
        stribeck_velocity=0.01,
        bias=-0.03,
        control_gain=0.37,
        control_limit=ControlLimits(-10.0, 8.0),
    )

    assert system.plant == Plant(
        static_forward=0.7,
        static_backward=0.5,
        coulomb_forward=0.6,
        coulomb_backward=0.4,
        damping_forward=1.7,
        damping_backward=2.5,
        breakaway_forward=0.7,
        breakaway_backward=0.5,
        stribeck_velocity=0.01,
        bias=-0.03,
        control_gain=0.37,
        lowest_control=-10.0,
        highest_control=8.0,
        time_step=0.05,
        velocity_threshold=1e-3,
    )
    assert not system.is_same_both_ways
    assert System().is_same_both_ways


def test_the_default_plant_is_that_of_the_paper() -> None:
    assert System().plant == Plant(
        static_forward=0.7,
        static_backward=0.7,
        coulomb_forward=0.6,
        coulomb_backward=0.6,
        damping_forward=0.05,
        damping_backward=0.05,
        breakaway_forward=0.6,
        breakaway_backward=0.6,
        stribeck_velocity=0.0,
        bias=0.0,
        control_gain=1.0,
        lowest_control=-0.9,
        highest_control=0.9,
        time_step=0.05,
        velocity_threshold=1e-3,
    )
