"""Descent of energy or smoothness among the plans that arrive: a quadratic program a motion.

Where the controls arrive in the first place is the matter of gauss_newton.py.
"""

import math
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray, IntArray, copy_into
from app.planning.linear_systems import solve_semidefinite
from app.planning.plant.motion import Motion, free_velocity_rates, free_velocity_row, motion_of
from app.planning.plant.rollout import terminal_state
from app.planning.plant.sensitivity import linearise
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from app.planning.refining.gauss_newton import EXACT, arrive, distance, terminal_error_of
from app.planning.stop import Flag

NUM_TERMINAL_ROWS = 2
MAX_ROWS = 24
"""Two terminal rows, and as many velocities as can be held at a switch at once."""
PROXIMAL = 1e-7
"""Added to the Hessian, which for the smoothness is singular; each step makes up for the last."""
SETTLED = 1e-10
"""A step smaller than this share of the control range is none."""
SLOWEST = 1e-13
"""A velocity that changes by less than this, m/s, does not change."""
WORTHWHILE = 1e-5
"""A new motion must lower the objective by this share."""
MAX_TRIALS = 7
RELEASED = 1e-8
"""A multiplier of the wrong sign counts from this share of the control range on."""
FREE, LOW, HIGH = 0, -1, 1


@compiled
def sum_of_squares(controls: FloatArray, differences: bool) -> float:
    """Return sum u_k^2 of `controls` (H,), or of their `differences` sum (u_{k+1} - u_k)^2."""
    total = 0.0
    if differences:
        for k in range(controls.size - 1):
            total += (controls[k + 1] - controls[k]) ** 2
    else:
        for control in controls:
            total += control * control
    return total


@compiled
def descend(
    controls: FloatArray, task: Task, differences: bool, iterations: int, stopped: Flag
) -> tuple[float, int]:
    """Lower the sum of squares of `controls` (H,) in place, or that of their `differences`.

    With the motion kept (motion.py), the terminal state is affine in the controls and the least
    objective that ends in the same state is a convex quadratic program, solved exactly. Where it
    presses against the edge of its motion, a step across the edge is tried, brought back to the
    terminal state by Gauss-Newton, and kept if that lowers the objective; then follows the next
    program. The terminal error never grows by more than rounding (`EXACT`).

    Returns the terminal error and the rollouts.
    """
    lowest, highest = task.plant.lowest_control, task.plant.highest_control
    p, v = terminal_state(controls, task.position, task.velocity, task.plant)
    reached = Task(task.position, task.velocity, p, v, task.plant)
    error = distance(p, v, task)
    allowed = error + EXACT
    rollouts = 1
    value = sum_of_squares(controls, differences)
    trial = np.empty(controls.size)
    for _ in range(iterations):
        if stopped[0]:
            break
        copy_into(trial, controls)
        across, spent = _least_within_motion(trial, task, differences, stopped)
        rollouts += spent
        fraction = 1.0
        for _ in range(MAX_TRIALS):
            _, spent = arrive(trial, reached, iterations, stopped)
            trial_error = terminal_error_of(trial, task)
            rollouts += spent + 1
            trial_value = sum_of_squares(trial, differences)
            if trial_error <= allowed and trial_value < (1.0 - WORTHWHILE) * value:
                break
            # The motion has its least; on across its edge, by halves.
            for k in range(controls.size):
                trial[k] = min(highest, max(lowest, controls[k] + fraction * across[k]))
            fraction *= 0.5
        else:
            break
        copy_into(controls, trial)
        value, error = trial_value, trial_error
    return error, rollouts


@compiled
def _least_within_motion(
    controls: FloatArray, task: Task, differences: bool, stopped: Flag
) -> tuple[FloatArray, int]:
    """Move `controls` (H,) to the least objective of their motion and terminal state, in place.

    The primal active-set method (Nocedal and Wright, Numerical Optimization, Algorithm 16.3) with a
    tridiagonal Hessian. Controls on their bound are frozen; velocities on the edge of their branch
    are held by a row each, beside the two rows of the terminal state. Also returns the direction
    (H,) in which the objective would fall if the motion did not matter, and the rollouts.
    """
    plant = task.plant
    horizon = controls.size
    motion = motion_of(controls, task)
    active = ActiveSet(
        frozen=np.zeros(horizon, dtype=np.int64),
        held=np.zeros(horizon, dtype=np.int64),
        held_at=np.zeros(MAX_ROWS, dtype=np.int64),
        rows=np.zeros((MAX_ROWS, horizon)),
    )
    terminal_rows = active.rows[:NUM_TERMINAL_ROWS]
    linearise(controls, task, terminal_rows)
    num_rows = NUM_TERMINAL_ROWS
    reduced, direction, rates = np.empty(horizon), np.empty(horizon), np.empty(horizon)
    control_range = plant.highest_control - plant.lowest_control
    for _ in range(6 * horizon):
        if stopped[0] or num_rows < 0:
            break
        rows = active.rows[:num_rows]
        multipliers = _newton_step(controls, rows, active.frozen, differences, direction, reduced)
        largest = 0.0
        for k in range(horizon):
            largest = max(largest, abs(direction[k]))
        if largest <= SETTLED * control_range:
            num_rows = _release(active, reduced, multipliers, num_rows, RELEASED * control_range)
            continue
        free_velocity_rates(motion, direction, plant, rates)
        fraction, blocking = _longest_step(controls, direction, motion, rates, active)
        for k in range(horizon):
            moved = controls[k] + fraction * direction[k]
            controls[k] = min(motion.highest_control[k], max(motion.lowest_control[k], moved))
            motion.free_velocity[k] += fraction * rates[k]
        if blocking >= horizon:
            at = blocking - horizon
            side = HIGH if rates[at] > 0.0 else LOW
            num_rows = _hold(active, motion, at, side, plant, num_rows)
        elif blocking >= 0 and direction[blocking] > 0.0:
            active.frozen[blocking], controls[blocking] = HIGH, motion.highest_control[blocking]
        elif blocking >= 0:
            active.frozen[blocking], controls[blocking] = LOW, motion.lowest_control[blocking]
    # Only the bounds of the controls stay; those of static friction belong to the motion.
    for k in range(horizon):
        if plant.lowest_control < controls[k] < plant.highest_control:
            active.frozen[k] = FREE
    _newton_step(controls, terminal_rows, active.frozen, differences, direction, reduced)
    return direction, 2


class ActiveSet(NamedTuple):
    """Which constraints hold as equalities; `FREE`, `LOW` and `HIGH` say which side of each."""

    frozen: IntArray
    """(H,), controls on their bounds."""
    held: IntArray
    """(H,), free velocities on the edge of their kind of step."""
    held_at: IntArray
    """(MAX_ROWS,), the steps of the held velocities, by row."""
    rows: FloatArray
    """(MAX_ROWS, H), derivatives by the controls: of the terminal state, then of what is held."""


@compiled
def _hold(
    active: ActiveSet, motion: Motion, at: int, side: int, plant: Plant, num_rows: int
) -> int:
    """Hold the free velocity of a step on its edge; return how many rows there are then.

    Returns -1 where there is no room for another.
    """
    if num_rows == MAX_ROWS:
        return -1
    active.held_at[num_rows] = at
    active.held[at] = side
    free_velocity_row(motion, at, plant, active.rows[num_rows])
    return num_rows + 1


@compiled
def _longest_step(
    controls: FloatArray,
    direction: FloatArray,
    motion: Motion,
    rates: FloatArray,
    active: ActiveSet,
) -> tuple[float, int]:
    """Return the share of `direction` (H,) that keeps the motion, and what blocks the rest of it.

    That is k for the bound of control k, H + k for the edge of free velocity k, -1 for nothing.
    """
    frozen, held = active.frozen, active.held
    horizon = controls.size
    longest, blocking = 1.0, -1
    for k in range(horizon):
        if frozen[k] == FREE and direction[k] != 0.0:
            bound = motion.highest_control[k] if direction[k] > 0.0 else motion.lowest_control[k]
            share = (bound - controls[k]) / direction[k]
            if share < longest:
                longest, blocking = max(share, 0.0), k
        if held[k] == FREE and abs(rates[k]) > SLOWEST:
            bound = motion.highest_velocity[k] if rates[k] > 0.0 else motion.lowest_velocity[k]
            share = (bound - motion.free_velocity[k]) / rates[k]
            if share < longest:
                longest, blocking = max(share, 0.0), horizon + k
    return longest, blocking


@compiled
def _newton_step(
    controls: FloatArray,
    rows: FloatArray,
    frozen: IntArray,
    differences: bool,
    direction: FloatArray,
    reduced: FloatArray,
) -> FloatArray:
    """Fill `direction` (H,) with the step to the least objective that leaves `rows` (M, H) alone.

    Solves T d + g = R^T y, R d = 0 for d on the free controls and y, with the tridiagonal Hessian
    T and gradient g of the objective: d = T^-1 (R^T y - g), (R T^-1 R^T) y = R T^-1 g. Fills
    `reduced` (H,) with g - R^T y and returns the multipliers y (M,).
    """
    num_rows, horizon = rows.shape
    diagonal, coupling = np.full(horizon, 2.0 + PROXIMAL), np.zeros(horizon)
    gradient = 2.0 * controls
    if differences:
        for k in range(horizon):
            neighbours = 0.0
            gradient[k] = 0.0
            for other in (k - 1, k + 1):
                if 0 <= other < horizon:
                    neighbours += 1.0
                    gradient[k] += 2.0 * (controls[k] - controls[other])
            diagonal[k] = 2.0 * neighbours + PROXIMAL
            if k + 1 < horizon and frozen[k] == FREE and frozen[k + 1] == FREE:
                coupling[k] = -2.0
    solved = np.empty((num_rows + 1, horizon))
    for i in range(num_rows + 1):
        for k in range(horizon):
            value = gradient[k] if i == num_rows else rows[i, k]
            solved[i, k] = value if frozen[k] == FREE else 0.0
    _solve_tridiagonal(diagonal, coupling, solved)
    schur, multipliers = np.empty((num_rows, num_rows)), np.empty(num_rows)
    for i in range(num_rows):
        for j in range(num_rows):
            schur[i, j] = np.sum(rows[i] * solved[j])
        multipliers[i] = np.sum(rows[i] * solved[num_rows])
    solve_semidefinite(schur, multipliers)
    for k in range(horizon):
        reduced[k] = gradient[k]
        direction[k] = -solved[num_rows, k]
        for i in range(num_rows):
            reduced[k] -= rows[i, k] * multipliers[i]
            direction[k] += solved[i, k] * multipliers[i]
    return multipliers


@compiled
def _solve_tridiagonal(
    diagonal: FloatArray, coupling: FloatArray, right_hand_sides: FloatArray
) -> None:
    """Solve for each of `right_hand_sides` (M, H) in place (Thomas); `diagonal` is overwritten."""
    horizon = diagonal.size
    for k in range(1, horizon):
        factor = coupling[k - 1] / diagonal[k - 1]
        diagonal[k] -= factor * coupling[k - 1]
        for i in range(len(right_hand_sides)):
            right_hand_sides[i, k] -= factor * right_hand_sides[i, k - 1]
    for i in range(len(right_hand_sides)):
        right_hand_sides[i, horizon - 1] /= diagonal[horizon - 1]
        for k in range(horizon - 2, -1, -1):
            right_hand_sides[i, k] -= coupling[k] * right_hand_sides[i, k + 1]
            right_hand_sides[i, k] /= diagonal[k]


@compiled
def _release(
    active: ActiveSet, reduced: FloatArray, multipliers: FloatArray, num_rows: int, least: float
) -> int:
    """Release the bound or row that the objective pulls away from most; return the rows left.

    Returns -1 where none pulls by more than `least`: the multipliers have the signs of a minimum.
    """
    frozen, held, held_at, rows = active.frozen, active.held, active.held_at, active.rows
    most, control, row = least, -1, -1
    for k in range(frozen.size):
        pull = frozen[k] * reduced[k]
        if pull > most:
            most, control = pull, k
    for i in range(NUM_TERMINAL_ROWS, num_rows):
        pull = held[held_at[i]] * multipliers[i] * math.sqrt(np.sum(rows[i] ** 2))
        if pull > most:
            most, row = pull, i
    if row >= 0:
        last = num_rows - 1
        held[held_at[row]] = FREE
        copy_into(rows[row], rows[last])
        held_at[row] = held_at[last]
        return last
    if control >= 0:
        frozen[control] = FREE
        return num_rows
    return -1
