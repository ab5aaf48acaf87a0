"""What to try where Gauss-Newton stalls: other motions, built from stretches of full control.

Descent from what is found here is the matter of gauss_newton.py, the order of things of
refinement.py.
"""

import math

import numpy as np

from app.compilation import compiled
from app.planning.plant.system import FloatArray, Parameters, step, terminal_state
from app.planning.refining.gauss_newton import terminal_error_of


@compiled
def overwrite_best_window(
    controls: FloatArray,
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
    stride: int,
) -> tuple[float, int]:
    """Overwrite the window of `controls` (H,) that lowers the error most; return error, rollouts.

    A window begins and ends at multiples of `stride` (or at H) and gets one of -u_max, 0 and u_max:
    it can start a motion, end one, turn it around, move its switches or wait. If none helps the
    controls stay as they are.
    """
    limit = parameters[3]
    horizon = controls.size
    best_error = terminal_error_of(controls, position, velocity, target, parameters)
    rollouts = 1
    best_begin, best_end, best_value = 0, 0, 0.0
    for begin in range(0, horizon, stride):
        for sign in range(-1, 2):
            p, v = position, velocity
            for k in range(begin, horizon):
                p, v = step(p, v, sign * limit, parameters)
                end = k + 1
                if end % stride != 0 and end < horizon:
                    continue
                p_end, v_end = terminal_state(controls[end:], p, v, parameters)
                rollouts += 1
                error = math.hypot(p_end - target[0], v_end - target[1])
                if error < best_error:
                    best_error = error
                    best_begin, best_end, best_value = begin, end, sign * limit
        # On to where the next window begins.
        position, velocity = terminal_state(
            controls[begin : begin + stride], position, velocity, parameters
        )
    controls[best_begin:best_end] = best_value
    return best_error, rollouts


@compiled
def switching_sequences(
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
    horizon: int,
    stride: int,
    num_sequences: int,
) -> tuple[FloatArray, int]:
    """Return the sequences (N, H) of three stretches that end nearest to the target, best first.

    A stretch is constant at -u_max, 0 or u_max and its ends lie at multiples of `stride`; N is
    `num_sequences`, or fewer where there are not so many. By Pontryagin's principle the extreme
    motions of a double integrator with friction are of this kind: accelerate, wait or coast, brake.
    Also returns the number of rollouts.
    """
    limit = parameters[3]
    errors = np.full(num_sequences, np.inf)
    # Two switches and three signs of each sequence kept.
    kept = np.zeros((num_sequences, 5), dtype=np.int64)
    rollouts = 0
    for first in range(-1, 2):
        p1, v1 = position, velocity
        for a in range(0, horizon, stride):
            if a > 0:
                p1, v1 = _hold(p1, v1, first * limit, stride, parameters)
            for second in range(-1, 2):
                # Each sequence once: without a first stretch its sign is moot.
                if second == first if a > 0 else first > -1:
                    continue
                p2, v2 = p1, v1
                for begin in range(a, horizon, stride):
                    b = min(begin + stride, horizon)
                    p2, v2 = _hold(p2, v2, second * limit, b - begin, parameters)
                    for third in range(-1, 2):
                        # Likewise without a third.
                        if (third == second) != (b == horizon):
                            continue
                        p, v = _hold(p2, v2, third * limit, horizon - b, parameters)
                        rollouts += 1
                        error = math.hypot(p - target[0], v - target[1])
                        worst = np.argmax(errors)
                        if error < errors[worst]:
                            errors[worst] = error
                            kept[worst] = np.array([a, b, first, second, third])
    order = np.argsort(errors)
    found = np.count_nonzero(np.isfinite(errors))
    sequences = np.empty((found, horizon))
    for i in range(found):
        a, b, first, second, third = kept[order[i]]
        sequences[i, :a] = first * limit
        sequences[i, a:b] = second * limit
        sequences[i, b:] = third * limit
    return sequences, rollouts


@compiled
def _hold(
    position: float, velocity: float, control: float, steps: int, parameters: Parameters
) -> tuple[float, float]:
    """Return the state after `steps` steps of one control."""
    for _ in range(steps):
        position, velocity = step(position, velocity, control, parameters)
    return position, velocity
