"""The least energy and smoothness of a motion: stationary, and IPOPT finds no less.

CasADi and IPOPT take their time (`pytest -m slow`).
"""

from typing import Any

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.objectives import CONTROL_ENERGY, CONTROL_SMOOTHNESS, Objective
from app.planning.plant.rollout import rollout
from app.planning.plant.sensitivity import linearise
from app.planning.prior import ControlPrior
from app.planning.problem import Problem
from app.planning.refining.refinement import Refinement, refine

ROUNDING = 2e-12


def test_the_least_energy_is_a_combination_of_the_sensitivities() -> None:
    # Stationarity where no bound or switch is in the way: u = J^T y.
    problem = Problem(np.array([0.0, 0.4]), np.array([1.4, 0.5]), horizon=64)
    refined = refine(problem, np.full((1, 64), 0.65), Refinement(), CONTROL_ENERGY)
    assert refined.errors[0] < ROUNDING
    controls = refined.controls[0]
    assert np.all(np.abs(controls) < problem.system.control_limit)
    jacobian = np.empty((2, 64))
    linearise(controls, problem.task, jacobian)
    multipliers, *_ = np.linalg.lstsq(jacobian.T, controls)
    np.testing.assert_allclose(jacobian.T @ multipliers, controls, atol=1e-6)


def least_by_ipopt(problem: Problem, controls: FloatArray, objective: Objective) -> float:
    """Return the least objective that IPOPT finds from `controls` (H,), in their own motion.

    The plant is written down anew: constraints keep each step on its branch (sliding forwards or
    backwards, stuck, broken away or stopped) and the terminal state where `controls` lead.
    """
    casadi: Any = pytest.importorskip("casadi")
    plant, horizon = problem.system.plant, problem.horizon
    static, dt, rest = plant.static_forward, plant.time_step, plant.velocity_threshold
    states = rollout(problem.system, problem.initial_state, controls[np.newaxis])[0]
    u = casadi.SX.sym("u", horizon)
    p, v = (casadi.SX(value) for value in problem.initial_state)
    low = np.full(horizon, plant.lowest_control)
    high = -low
    constraints = []
    for k, (before, after) in enumerate(zip(states[:-1, 1], states[1:, 1], strict=True)):
        at_rest = abs(before) < rest
        if at_rest and abs(controls[k]) <= static:
            low[k], high[k] = max(low[k], -static), min(high[k], static)
            v = casadi.SX(0)
            continue
        side = np.sign(controls[k] if at_rest else before)
        if at_rest and side > 0:
            low[k] = static
        elif at_rest:
            high[k] = -static
        damping = 0.0 if at_rest else plant.damping_forward
        free = v + dt * (u[k] - side * plant.coulomb_forward - damping * v)
        if not at_rest and after == 0:
            constraints.append((side * free, -np.inf, 0.0))
            v = casadi.SX(0)
            continue
        if k == horizon - 1:
            bounds = (0.0, np.inf)
        else:
            bounds = (0.0, rest) if abs(after) < rest else (rest, np.inf)
        constraints.append((side * free, *bounds))
        v = free
        p = p + dt * v
    constraints += [(p, states[-1, 0], states[-1, 0]), (v, states[-1, 1], states[-1, 1])]
    expressions, lows, highs = zip(*constraints, strict=True)
    cost = casadi.sumsqr(u if objective is CONTROL_ENERGY else u[1:] - u[:-1])
    program = {"x": u, "f": cost, "g": casadi.vertcat(*expressions)}
    options = {"print_level": 0, "sb": "yes", "tol": 1e-9, "bound_relax_factor": 0.0}
    solver = casadi.nlpsol("least", "ipopt", program, {"print_time": 0, "ipopt": options})
    found = solver(x0=controls, lbx=low, ubx=high, lbg=lows, ubg=highs)
    assert solver.stats()["success"]
    return float(found["f"])


@pytest.mark.slow
@pytest.mark.parametrize("objective", [CONTROL_ENERGY, CONTROL_SMOOTHNESS])
@pytest.mark.parametrize("target_speed", [0.0, 0.5])
def test_ipopt_finds_no_less_in_the_same_motion(objective: Objective, target_speed: float) -> None:
    savings = []
    for rng in np.random.default_rng(17).spawn(100):
        start = np.array([rng.uniform(-1, 1), rng.uniform(-0.5, 0.5)])
        target = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1) * target_speed])
        problem = Problem(start, target)
        proposed = ControlPrior().sample(4, problem.horizon, problem.system.plant, rng)
        refined = refine(problem, proposed, Refinement(), objective)
        best = refined.controls[np.argmin(refined.errors)]
        least = best if objective is CONTROL_ENERGY else np.diff(best)
        ours = float(np.sum(least**2))
        savings.append((ours - least_by_ipopt(problem, best, objective)) / max(ours, 1e-3))
    assert max(savings) < 1e-3
