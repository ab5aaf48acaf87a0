from dataclasses import replace
from typing import Any

import pytest
from pydantic import TypeAdapter

from app.planning.plant.plant_range import PlantRange
from app.planning.plant.system import ByDirection, ControlLimits, System

SLIPPERY_TO_NOMINAL = replace(PlantRange.only(System()), coulomb_friction=(0.1, 0.6))


def test_a_range_of_one_plant_covers_that_plant_alone() -> None:
    only = PlantRange.only(System())

    assert only.covers(System())
    assert not only.covers(System(static_friction=0.71))
    assert only.nearest(System(static_friction=0.8, control_limit=2.0)) == System()


def test_a_range_covers_its_ends_and_what_lies_between() -> None:
    for friction, covered in ((0.1, True), (0.3, True), (0.6, True), (0.09, False), (0.61, False)):
        assert SLIPPERY_TO_NOMINAL.covers(System(coulomb_friction=friction)) is covered


def test_the_nearest_plant_keeps_what_is_within_and_moves_what_is_not() -> None:
    asked = System(static_friction=0.9, coulomb_friction=0.05)

    assert SLIPPERY_TO_NOMINAL.nearest(asked) == System(coulomb_friction=0.1)


@pytest.mark.parametrize(
    "part",
    [
        {"static_friction": ByDirection(0.7, 0.71)},
        {"coulomb_friction": ByDirection(0.6, 0.5)},
        {"viscous_damping": ByDirection(0.05, 0.06)},
        {"stribeck_velocity": 0.01},
        {"bias": 1e-6},
        {"control_gain": 2.0},
        {"control_limit": ControlLimits(-0.8, 0.9)},
    ],
)
def test_a_range_covers_no_plant_with_more_than_it_has(part: dict[str, Any]) -> None:
    system = replace(System(), **part)

    assert not SLIPPERY_TO_NOMINAL.covers(system)
    with pytest.raises(ValueError, match="the same both ways"):
        PlantRange.only(system)


def test_the_same_friction_said_for_both_ways_is_covered() -> None:
    both_ways = System(
        ByDirection(0.7, 0.7), ByDirection(0.6, 0.6), control_limit=ControlLimits(-0.9, 0.9)
    )

    assert SLIPPERY_TO_NOMINAL.covers(both_ways)
    assert PlantRange.only(both_ways) == PlantRange.only(System())


def test_it_says_in_words_what_it_covers() -> None:
    text = str(SLIPPERY_TO_NOMINAL)
    assert "static_friction 0.7, coulomb_friction 0.1 to 0.6," in text
    assert text.endswith("the same both ways, without bias, gain or Stribeck effect")


def test_it_travels_as_json_and_refuses_a_range_the_wrong_way_round() -> None:
    adapter = TypeAdapter(PlantRange)
    assert adapter.validate_json(adapter.dump_json(SLIPPERY_TO_NOMINAL)) == SLIPPERY_TO_NOMINAL

    with pytest.raises(ValueError, match="coulomb_friction is a range from"):
        replace(SLIPPERY_TO_NOMINAL, coulomb_friction=(0.6, 0.1))
