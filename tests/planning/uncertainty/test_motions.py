"""Motions to start from: plain stretches within the limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.plant.friction import holding_control
from app.planning.plant.system import System
from app.planning.uncertainty.motions import MOST, draw_motions
from tests.planning.plants import machines, systems


@given(systems() | machines(), st.integers(1, 40))
def test_they_have_few_stretches_within_the_limits(system: System, horizon: int) -> None:
    plant = system.plant
    controls = draw_motions(np.random.default_rng(0), 50, horizon, plant)

    assert controls.shape == (50, horizon)
    assert controls.min() >= plant.lowest_control
    assert controls.max() <= plant.highest_control
    assert np.count_nonzero(np.diff(controls), axis=1).max(initial=0) < MOST


def test_the_ends_of_stretches_are_spread_evenly_and_the_levels_as_often_as_told() -> None:
    plant = System().plant
    controls = draw_motions(np.random.default_rng(0), 4000, 60, plant)

    changes = np.count_nonzero(np.diff(controls), axis=0)
    assert changes.min() > 0.8 * changes.mean()
    assert changes.max() < 1.2 * changes.mean()
    for level, share in ((0.9, 0.2), (-0.9, 0.2), (0.65 * 0.9, 0.1), (holding_control(plant), 0.2)):
        assert np.mean(controls == level) == pytest.approx(share, abs=0.02)
