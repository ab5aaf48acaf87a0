"""What to try where Gauss-Newton stalls: other motions, built from stretches of full control.

Descent from what is found here is the matter of gauss_newton.py, the order of things of
refinement.py.
"""

from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray, IntArray
from app.planning.plant.friction import holding_control
from app.planning.plant.rollout import step, terminal_state
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from app.planning.refining.gauss_newton import distance, terminal_error_of

LEVELS = (0, 1, 2)
"""Of a stretch: which of `stretch_controls` it has."""


@compiled
def stretch_controls(plant: Plant) -> tuple[float, float, float]:
    """Return the controls of stretches: full one way, what holds a mass, full the other way."""
    return plant.lowest_control, holding_control(plant), plant.highest_control


@compiled
def overwrite_best_window(controls: FloatArray, task: Task, stride: int) -> tuple[float, int]:
    """Overwrite the window of `controls` (H,) that lowers the error most; return error, rollouts.

    A window begins and ends at multiples of `stride` (or at H) and gets full or no control:
    it can start a motion, end one, turn it around, move its switches or wait. If none helps the
    controls stay as they are.
    """
    plant = task.plant
    horizon = controls.size
    best_error = terminal_error_of(controls, task)
    rollouts = 1
    best_begin, best_end, best_control = 0, 0, 0.0
    levels = stretch_controls(plant)
    position, velocity = task.position, task.velocity
    for begin in range(0, horizon, stride):
        for control in levels:
            p, v = position, velocity
            for k in range(begin, horizon):
                p, v = step(p, v, control, plant)
                end = k + 1
                if end % stride != 0 and end < horizon:
                    continue
                p_end, v_end = terminal_state(controls[end:], p, v, plant)
                rollouts += 1
                error = distance(p_end, v_end, task)
                if error < best_error:
                    best_error = error
                    best_begin, best_end, best_control = begin, end, control
        # On to where the next window begins.
        position, velocity = terminal_state(
            controls[begin : begin + stride], position, velocity, plant
        )
    controls[best_begin:best_end] = best_control
    return best_error, rollouts


class Shortlist(NamedTuple):
    """The N best sequences so far, in no order."""

    errors: FloatArray
    """(N,), infinite where there is none yet."""
    stretches: IntArray
    """(N, 5): the steps of the two switches, and the levels of the three stretches."""


@compiled
def switching_sequences(
    task: Task, horizon: int, stride: int, num_sequences: int
) -> tuple[FloatArray, int]:
    """Return the sequences (N, H) of three stretches that end nearest to the target, best first.

    A stretch is constant at full or no control and its ends lie at multiples of `stride`; N is
    `num_sequences`, or fewer where there are not so many. By Pontryagin's principle the extreme
    motions of a double integrator with friction are of this kind: accelerate, wait or coast, brake.
    Also returns the number of rollouts.
    """
    plant = task.plant
    best = Shortlist(np.full(num_sequences, np.inf), np.zeros((num_sequences, 5), dtype=np.int64))
    rollouts, levels = 0, stretch_controls(plant)
    for first in LEVELS:
        p, v = task.position, task.velocity
        for a in range(0, horizon, stride):
            if a > 0:
                p, v = _hold(p, v, levels[first], stride, plant)
            for second in LEVELS:
                # Each sequence once: without a first stretch its level is moot.
                if second == first if a > 0 else first > 0:
                    continue
                rollouts += _try_ends(best, task, levels, p, v, a, first, second, horizon, stride)
    order = np.argsort(best.errors)
    count = np.count_nonzero(np.isfinite(best.errors))
    sequences = np.empty((count, horizon))
    for i in range(count):
        a, b, first, second, third = best.stretches[order[i]]
        sequences[i, :a] = levels[first]
        sequences[i, a:b] = levels[second]
        sequences[i, b:] = levels[third]
    return sequences, rollouts


@compiled
def _try_ends(
    best: Shortlist,
    task: Task,
    levels: tuple[float, float, float],
    position: float,
    velocity: float,
    a: int,
    first: int,
    second: int,
    horizon: int,
    stride: int,
) -> int:
    """Try every end of the second stretch, from its start at step `a`, and every third stretch.

    Returns the number of rollouts.
    """
    plant = task.plant
    rollouts = 0
    for begin in range(a, horizon, stride):
        b = min(begin + stride, horizon)
        position, velocity = _hold(position, velocity, levels[second], b - begin, plant)
        for third in LEVELS:
            # Each sequence once: without a third stretch its level is moot.
            if (third == second) != (b == horizon):
                continue
            p, v = _hold(position, velocity, levels[third], horizon - b, plant)
            rollouts += 1
            error = distance(p, v, task)
            worst = np.argmax(best.errors)
            if error < best.errors[worst]:
                best.errors[worst] = error
                for i, value in enumerate((a, b, first, second, third)):
                    best.stretches[worst, i] = value
    return rollouts


@compiled
def _hold(
    position: float, velocity: float, control: float, steps: int, plant: Plant
) -> tuple[float, float]:
    """Return the state after `steps` steps of one control."""
    for _ in range(steps):
        position, velocity = step(position, velocity, control, plant)
    return position, velocity
