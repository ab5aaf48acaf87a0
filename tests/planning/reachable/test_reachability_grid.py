"""The floor against dynamic programming: a fine grid of states, each with one true way to it."""

import numpy as np
import pytest

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import resting_controls
from app.planning.plant.rollout import step
from app.planning.plant.system import ByDirection, ControlLimits, Plant, System
from app.planning.problem import Problem
from app.planning.reachable.reachability import reachability

CELL = 2e-3
HALF = 300
"""The grid holds positions and velocities up to HALF * CELL from the start's position."""
LEVELS = 25


@compiled
def reached(velocity: float, horizon: int, controls: FloatArray, plant: Plant) -> FloatArray:
    """Return states reached from (0, velocity) in `horizon` steps, at most one a cell: (N, 2).

    Every state kept is one that the controls really lead to; the grid only thins them out.
    """
    size = 2 * HALF + 1
    states = np.empty((size * size, 2))
    states[0, 0], states[0, 1] = 0.0, velocity
    count = 1
    for _ in range(horizon):
        taken = np.zeros((size, size), dtype=np.bool_)
        following = np.empty((size * size, 2))
        found = 0
        for i in range(count):
            for control in controls:
                p, v = step(states[i, 0], states[i, 1], control, plant)
                row, column = round(p / CELL) + HALF, round(v / CELL) + HALF
                inside = 0 <= row < size and 0 <= column < size
                if inside and not taken[row, column]:
                    taken[row, column] = True
                    following[found, 0], following[found, 1] = p, v
                    found += 1
        states, count = following, found
    return states[:count].copy()


@pytest.mark.parametrize(
    ("system", "velocity", "horizon"),
    [
        (System(), 0.0, 12),
        (System(), 0.0, 24),
        (System(), 0.2, 12),
        (System(), -0.15, 20),
        (System(static_friction=0.8), 0.05, 16),
        (System(viscous_damping=0.0, coulomb_friction=0.3), -0.1, 12),
        (System(control_limit=0.65), 0.3, 16),
        (System(ByDirection(0.7, 0.4), ByDirection(0.5, 0.2), ByDirection(0.1, 3.0)), 0.0, 16),
        (System(bias=0.3, control_limit=ControlLimits(-0.5, 0.8)), 0.0, 16),
        (System(bias=1.0, control_limit=0.2), -0.1, 16),
        (System(bias=-0.65, control_gain=3.0, control_limit=0.2), 0.1, 16),
        (System(0.8, 0.3, stribeck_velocity=0.03), 0.0, 16),
        (System(0.8, ByDirection(0.1, 0.5), stribeck_velocity=0.1, bias=0.2), -0.1, 16),
    ],
)
def test_the_grid_never_beats_the_floor_and_comes_near_it(
    system: System, velocity: float, horizon: int
) -> None:
    plant = system.plant
    lowest, highest = plant.lowest_control, plant.highest_control
    # Both sides of the thresholds of static friction, where controls change what they do.
    low, high = resting_controls(plant)
    edges = np.array([low - 1e-9, low, high, high + 1e-9])
    levels = np.unique(
        np.concatenate([np.linspace(lowest, highest, LEVELS), edges.clip(lowest, highest)])
    )
    states = reached(velocity, horizon, levels, plant)
    assert len(states) > 20
    start = np.array([0.0, velocity])
    rng = np.random.default_rng(0)

    for state in states[rng.choice(len(states), size=min(len(states), 200), replace=False)]:
        result = reachability(Problem(start, state, system, horizon))
        assert result.floor < 1e-9 + result.floor_error

    spread = np.ptp(states, axis=0) + 0.05
    targets = states.mean(axis=0) + spread * rng.uniform(-1, 1, (200, 2))
    for target in targets:
        nearest = np.linalg.norm(states - target, axis=1).min()
        result = reachability(Problem(start, target, system, horizon))
        assert result.floor <= nearest + 1e-9 + result.floor_error
        assert nearest <= result.floor + 6 * CELL
