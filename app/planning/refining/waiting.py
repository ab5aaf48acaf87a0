"""Waiting after the motion in place of before it: what lowers the stuck steps of a plan.

Where the controls arrive in the first place is the matter of gauss_newton.py.
"""

import numpy as np

from app.planning.arrays import FloatArray, IntArray
from app.planning.metrics import stuck_steps, terminal_error
from app.planning.plant.friction import holding_control
from app.planning.plant.rollout import rollout
from app.planning.problem import Problem

WAITING_ROLLOUTS = 2
"""Of each candidate: before and after."""


def wait_at_the_end(problem: Problem, controls: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Move the steps of `controls` (K, H) in which nothing moves to the end of their plan.

    The motion stays the same but comes at once and without a pause; then the mass waits, with no
    more control than holds it. A plan is left alone where this takes no stuck step away or makes
    the terminal error grow: a target that is to be passed in motion has to be reached with the last
    step.

    Returns:
        The controls (K, H) and their terminal errors (K,).
    """
    states = rollout(problem.system, problem.initial_state, controls)
    pauses = np.all(states[:, 1:] == states[:, :-1], axis=-1)
    pauses_last = np.argsort(pauses, axis=-1, kind="stable")
    held = np.where(pauses, holding_control(problem.system.plant), controls)
    moved = np.take_along_axis(held, pauses_last, axis=-1)
    moved_states = rollout(problem.system, problem.initial_state, moved)

    errors, stuck = _measures(problem, controls, states)
    moved_errors, moved_stuck = _measures(problem, moved, moved_states)
    better = (moved_errors <= errors) & (moved_stuck < stuck)
    kept = np.where(better[:, np.newaxis], moved, controls)
    return kept, np.where(better, moved_errors, errors)


def _measures(
    problem: Problem, controls: FloatArray, states: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return terminal errors and stuck steps, (K,) each."""
    errors = terminal_error(states[:, -1], problem.target_state)
    return errors, stuck_steps(states, controls, problem.target_state[0], problem.system)
