from dataclasses import replace

import pytest
from pydantic import TypeAdapter

from app.planning.plant.plant_range import PlantRange
from app.planning.plant.system import System

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


def test_it_says_in_words_what_it_covers() -> None:
    assert "static_friction 0.7, coulomb_friction 0.1 to 0.6," in str(SLIPPERY_TO_NOMINAL)


def test_it_travels_as_json_and_refuses_a_range_the_wrong_way_round() -> None:
    adapter = TypeAdapter(PlantRange)
    assert adapter.validate_json(adapter.dump_json(SLIPPERY_TO_NOMINAL)) == SLIPPERY_TO_NOMINAL

    with pytest.raises(ValueError, match="coulomb_friction is a range from"):
        replace(SLIPPERY_TO_NOMINAL, coulomb_friction=(0.6, 0.1))
