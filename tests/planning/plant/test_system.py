"""The plant's parameters: which ones are possible, and the paper's."""

import math

import pytest

from app.planning.plant.system import Plant, System


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
        *(
            ({name: value}, name)
            for name in System.__dataclass_fields__
            for value in (math.nan, math.inf, -math.inf)
        ),
    ],
)
def test_an_impossible_plant_is_refused_by_the_name_of_its_parameter(
    parameters: dict[str, float], named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        System(**parameters)


def test_the_limits_of_what_is_possible_are_accepted() -> None:
    System(static_friction=0.0, coulomb_friction=0.0, viscous_damping=0.0)
    System(static_friction=0.6, coulomb_friction=0.6)
    System(viscous_damping=19.99)


def test_the_default_plant_is_that_of_the_paper() -> None:
    assert System().plant == Plant(
        static_friction=0.7,
        coulomb_friction=0.6,
        viscous_damping=0.05,
        lowest_control=-0.9,
        highest_control=0.9,
        time_step=0.05,
        velocity_threshold=1e-3,
    )
