"""Controls to identify a machine by: how far they take it, and that they stay within a stroke."""

import numpy as np
import pytest

from app.planning.identification.excitation import StrokeTooShort, excitation, travel
from app.planning.plant.system import ByDirection, System

SYSTEMS = [
    System(),
    System(0.26, 0.215, 1.2, control_gain=0.37, control_limit=10.0, time_step=0.01),
    System(ByDirection(2.0, 2.2), 1.0, 0.3, bias=0.2, control_gain=0.44, control_limit=8.0),
]


@pytest.mark.parametrize("system", SYSTEMS)
def test_it_stays_within_a_stroke_by_shorter_parts(system: System) -> None:
    whole = excitation(system)
    lowest, highest = travel(system, whole)
    assert lowest <= 0.0 < highest
    controls = excitation(system, 0.4 * (highest - lowest))
    assert len(controls) < len(whole)
    assert 0.2 < np.subtract(*travel(system, controls)) / (lowest - highest) <= 0.4


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_stroke_that_is_long_enough_changes_nothing(system: System) -> None:
    lowest, highest = travel(system, excitation(system))
    np.testing.assert_equal(excitation(system, highest - lowest), excitation(system))


def test_a_stroke_in_which_nothing_can_be_told_is_refused() -> None:
    with pytest.raises(StrokeTooShort, match=r"the shortest .* take .* m"):
        excitation(System(), 1e-5)
