"""The motion of a plan: while it is kept to, the velocities are affine in the controls."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.plant.motion import free_velocity_rates, free_velocity_row, motion_of
from app.planning.problem import Problem
from tests.planning.plants import random_system

HORIZON = 24
seeds = st.integers(0, 2**32 - 1)


def random_plan(seed: int) -> tuple[Problem, FloatArray, FloatArray]:
    """Return a problem, controls within its limits and a direction to change them in, (H,)."""
    rng = np.random.default_rng(seed)
    problem = Problem(rng.uniform(-1, 1, 2), np.zeros(2), random_system(rng), HORIZON)
    plant = problem.system.plant
    levels = rng.uniform(plant.lowest_control, plant.highest_control, HORIZON // 4)
    controls = np.repeat(levels, 4)
    return problem, controls, rng.uniform(-1, 1, HORIZON)


@given(seeds)
def test_a_plan_keeps_to_the_bounds_of_its_own_motion(seed: int) -> None:
    problem, controls, _ = random_plan(seed)
    motion = motion_of(controls, problem.task)

    assert np.all((motion.lowest_control <= controls) & (controls <= motion.highest_control))
    assert np.all(motion.lowest_velocity <= motion.free_velocity)
    assert np.all(motion.free_velocity <= motion.highest_velocity)


@given(seeds)
def test_velocities_change_at_the_rates_of_the_motion_as_long_as_it_is_kept_to(seed: int) -> None:
    problem, controls, direction = random_plan(seed)
    nudge, rates = 1e-6, np.empty(HORIZON)
    motion = motion_of(controls, problem.task)
    free_velocity_rates(motion, direction, problem.system.plant, rates)
    nudged = motion_of(controls + nudge * direction, problem.task)
    for kept in ("direction", "by_velocity", "by_control"):
        assume(np.array_equal(getattr(nudged, kept), getattr(motion, kept)))

    change = (nudged.free_velocity - motion.free_velocity) / nudge
    np.testing.assert_allclose(rates, change, atol=1e-8)


@given(seeds)
def test_the_rates_are_the_rows_of_the_derivative_along_the_direction(seed: int) -> None:
    problem, controls, direction = random_plan(seed)
    motion = motion_of(controls, problem.task)
    rows, rates = np.empty((HORIZON, HORIZON)), np.empty(HORIZON)
    for k in range(HORIZON):
        free_velocity_row(motion, k, problem.system.plant, rows[k])
    free_velocity_rates(motion, direction, problem.system.plant, rates)

    np.testing.assert_allclose(rows @ direction, rates, atol=1e-12)
