"""Gauss-Newton on the terminal errors over an ensemble, within the control bounds: one candidate.

What one plant makes of the controls is in refining/gauss_newton.py, the linear algebra of a step in
normal_equations.py.
"""

import math

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray, IntArray, copy_into
from app.planning.plant.rollout import terminal_state
from app.planning.plant.sensitivity import linearise
from app.planning.refining.gauss_newton import distance
from app.planning.stop import Flag
from app.planning.uncertainty.ensemble import Scenarios, scenario
from app.planning.uncertainty.normal_equations import damped_step, normal_equations
from app.planning.uncertainty.risk import tail_weights

INITIAL_DAMPING = 1e-2
LESS_DAMPING, MORE_DAMPING = 0.3, 6.0
LEAST_DAMPING = 1e-7
MAX_TRIALS = 7
STALLED = 1e-4
"""A step that lowers the risk by a smaller share than this is the last one."""
STEEPNESS = 8.0
"""How fast the weight of errors that do not count falls with their share of those that do."""
BLUNT = 2e-3
"""m: errors below this are weighed as if they were squared."""


@compiled
def descend_risk(
    controls: FloatArray,
    scenarios: Scenarios,
    counted: float,
    squared: bool,
    iterations: int,
    stopped: Flag,
) -> tuple[float, int]:
    """Lower the risk of `controls` (H,) in place; return it and the rollouts.

    Levenberg-Marquardt on the terminal errors of all scenarios, each by its weight. `squared`, the
    risk is the mean of the squares and all weigh the same; otherwise it is the mean of the
    `counted` greatest errors, and reweighting makes the squares stand for them: an error e that
    counts weighs 1/e. The controls change only where the true rollouts improve, so the risk never
    grows.
    """
    num_plants, horizon = len(scenarios.plants), controls.size
    plant = scenario(scenarios, 0).plant
    lowest, highest = plant.lowest_control, plant.highest_control
    rows = np.empty((2 * num_plants, horizon))
    residuals = np.empty(2 * num_plants)
    errors, weights = np.empty(num_plants), np.empty(num_plants)
    trial, gradient, step = np.empty(horizon), np.empty(horizon), np.empty(horizon)
    free = np.empty(horizon, dtype=np.int64)
    risk = _risk(controls, scenarios, counted, squared, errors, weights)
    rollouts = num_plants
    damping = INITIAL_DAMPING
    for _ in range(iterations):
        if stopped[0]:
            break
        _weigh(errors, weights, squared)
        scale = _linearise(controls, scenarios, weights, rows, residuals, gradient)
        rollouts += num_plants
        if scale == 0.0:
            break
        num_free = _find_free(controls, gradient, lowest, highest, free)
        if num_free == 0:
            break
        normal = normal_equations(rows, residuals, free[:num_free])
        before = risk
        for _ in range(MAX_TRIALS):
            damped_step(normal, damping * scale / horizon, step)
            copy_into(trial, controls)
            for j in range(num_free):
                k = free[j]
                trial[k] = min(highest, max(lowest, controls[k] + step[j]))
            trial_risk = _risk(trial, scenarios, counted, squared, errors, weights)
            rollouts += num_plants
            if trial_risk < risk:
                risk = trial_risk
                copy_into(controls, trial)
                damping = max(LESS_DAMPING * damping, LEAST_DAMPING)
                break
            damping *= MORE_DAMPING
        if risk > (1.0 - STALLED) * before:
            break
    return risk, rollouts


@compiled
def _weigh(errors: FloatArray, weights: FloatArray, squared: bool) -> None:
    """Turn how much each error counts, `weights` (S,), into the weight of its square.

    Those that do not count weigh less the smaller they are, but for nothing they count as soon as
    a step makes them grow.
    """
    least_counted = math.inf
    for s in range(errors.size):
        if weights[s] > 0.0:
            least_counted = min(least_counted, errors[s])
    for s in range(errors.size):
        if squared:
            weights[s] = 1.0
        else:
            share = (errors[s] + BLUNT) / (least_counted + BLUNT)
            weights[s] = min(1.0, share**STEEPNESS) / (errors[s] + BLUNT)


@compiled
def _linearise(
    controls: FloatArray,
    scenarios: Scenarios,
    weights: FloatArray,
    rows: FloatArray,
    residuals: FloatArray,
    gradient: FloatArray,
) -> float:
    """Fill the weighted residuals (2S,), their derivatives `rows` (2S, H) and the gradient (H,).

    Returns the sum of the squares of all derivatives.
    """
    scale = 0.0
    gradient[:] = 0.0
    for s in range(weights.size):
        task = scenario(scenarios, s)
        jacobian = rows[2 * s : 2 * s + 2]
        p, v = linearise(controls, task, jacobian)
        weight = math.sqrt(weights[s])
        residuals[2 * s] = weight * (p - task.target_position)
        residuals[2 * s + 1] = weight * (v - task.target_velocity)
        for k in range(controls.size):
            jacobian[0, k] *= weight
            jacobian[1, k] *= weight
            gradient[k] += jacobian[0, k] * residuals[2 * s]
            gradient[k] += jacobian[1, k] * residuals[2 * s + 1]
            scale += jacobian[0, k] ** 2 + jacobian[1, k] ** 2
    return scale


@compiled
def _find_free(
    controls: FloatArray, gradient: FloatArray, lowest: float, highest: float, free: IntArray
) -> int:
    """Fill `free` with the controls that can move to lower the risk; return how many there are."""
    num_free = 0
    for k in range(controls.size):
        is_pressed = (controls[k] >= highest and gradient[k] < 0.0) or (
            controls[k] <= lowest and gradient[k] > 0.0
        )
        if not is_pressed and gradient[k] != 0.0:
            free[num_free] = k
            num_free += 1
    return num_free


@compiled
def _risk(
    controls: FloatArray,
    scenarios: Scenarios,
    counted: float,
    squared: bool,
    errors: FloatArray,
    weights: FloatArray,
) -> float:
    """Return the risk of `controls` (H,), and fill errors and weights (S,)."""
    total = 0.0
    for s in range(errors.size):
        task = scenario(scenarios, s)
        p, v = terminal_state(controls, task.position, task.velocity, task.plant)
        errors[s] = distance(p, v, task)
        total += errors[s] ** 2
    if squared:
        return total / errors.size
    return tail_weights(errors, counted, weights)
