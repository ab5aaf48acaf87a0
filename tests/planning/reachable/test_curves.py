"""Edges that bend: held against the curves themselves, on a fine grid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.plant.friction import kept_velocity
from app.planning.plant.system import ByDirection, System
from app.planning.reachable.curves import bent, straightening, thinned
from app.planning.reachable.polylines import Piece

HORIZON = 64
RACK = System(1.2, 0.405, 2.73, stribeck_velocity=0.0135, control_limit=5.0, time_step=0.005)
SLOW = System(ByDirection(0.9, 0.8), 0.1, ByDirection(0.0, 2.0), stribeck_velocity=0.3)
seeds = st.integers(0, 2**32 - 1)


def random_line(rng: np.random.Generator, low: float, high: float) -> FloatArray:
    """Return a line with slopes up to three, and with jumps."""
    rows = [(low, 0.0)]
    for velocity in np.sort(rng.uniform(low, high, int(rng.integers(1, 8)))):
        before, y = rows[-1]
        rows.append((velocity, y + rng.uniform(-3, 3) * (velocity - before)))
        if rng.random() < 0.3:
            rows.append((velocity, rng.uniform(-1, 1)))
    return np.array(rows)


def height(line: FloatArray, at: FloatArray) -> FloatArray:
    return np.interp(at, line[:, 0], line[:, 1])


@pytest.mark.parametrize("system", [RACK, SLOW])
@given(seed=seeds, forward=st.booleans())
def test_a_bent_line_is_the_curve_to_within_the_straightening(
    system: System, seed: int, forward: bool
) -> None:
    rng, plant = np.random.default_rng(seed), system.plant
    direction = 1.0 if forward else -1.0
    speeds = plant.velocity_threshold, 8 * plant.stribeck_velocity
    line = random_line(rng, *sorted(direction * speed for speed in speeds))

    curve = bent(Piece(line, line), direction, HORIZON, plant).upper

    assert np.all(np.diff(curve[:, 0]) >= 0)
    for end in (0, -1):
        assert curve[end, 0] == kept_velocity(line[end, 0], direction, plant)
        assert curve[end, 1] == line[end, 1]
    # Off the vertices of the line, where it may jump.
    velocities = rng.uniform(line[0, 0], line[-1, 0], 500)
    kept = np.array([kept_velocity(v, direction, plant) for v in velocities])
    off = np.abs(height(curve, kept) - height(line, velocities))
    near_a_jump = np.abs(velocities[:, None] - line[:, 0]).min(axis=1) < 1e-9
    assert np.all(off[~near_a_jump] <= 3 * straightening(HORIZON, plant))


@given(seed=seeds, tolerance=st.floats(1e-6, 1e-2), size=st.integers(1, 60))
def test_a_thinned_line_passes_all_that_it_lacks_within_the_tolerance(
    seed: int, tolerance: float, size: int
) -> None:
    rng = np.random.default_rng(seed)
    velocities = np.sort(rng.integers(0, 40, size)).astype(float)
    line = np.column_stack([velocities, np.cumsum(rng.normal(0, tolerance, size))])

    thin = thinned(line, tolerance)

    assert len(thin) <= len(line)
    rows = {tuple(row) for row in line}
    assert all(tuple(row) in rows for row in thin)
    np.testing.assert_array_equal(thin[[0, -1]], line[[0, -1]])
    jumps = velocities[:-1][np.diff(velocities) == 0]
    single = ~np.isin(velocities, jumps)
    off = np.abs(height(thin, velocities[single]) - line[single, 1])
    assert np.all(off <= tolerance * (1 + 1e-9))
    # Both ends of a jump are kept.
    for at in jumps:
        here = line[velocities == at]
        assert tuple(here[0]) in {tuple(row) for row in thin}
        assert tuple(here[-1]) in {tuple(row) for row in thin}


def test_a_straight_line_keeps_its_ends_alone() -> None:
    velocities = np.linspace(0.0, 1.0, 50)
    line = np.column_stack([velocities, 3.0 * velocities - 1.0])

    np.testing.assert_array_equal(thinned(line, 1e-9), line[[0, -1]])
