"""The derivative of the terminal state, held against differences of rollouts."""

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.rollout import rollout, step
from app.planning.plant.sensitivity import linearise
from app.planning.plant.system import System
from app.planning.problem import Problem
from tests.planning.plants import random_system


def terminal_jacobian(
    problem: Problem, controls: FloatArray
) -> tuple[tuple[float, float], FloatArray]:
    """Return the terminal state of `controls` (H,), and its derivative (2, H)."""
    jacobian = np.empty((2, controls.size))
    return linearise(controls, problem.task, jacobian), jacobian


def distance_to_a_switch(problem: Problem, controls: FloatArray) -> float:
    """How far, in velocity or control, any step taken is from the nearest other kind of step."""
    system = problem.system
    position, velocity = problem.initial_state
    nearest = np.inf
    for control in controls:
        at_rest = abs(velocity) < system.velocity_threshold
        nearest = min(nearest, abs(abs(velocity) - system.velocity_threshold))
        if at_rest:
            nearest = min(nearest, abs(abs(control) - system.static_friction))
        else:
            friction = np.copysign(system.coulomb_friction, velocity)
            drift = control - friction - system.viscous_damping * velocity
            nearest = min(nearest, abs(velocity + system.time_step * drift))
        position, velocity = step(position, velocity, control, system.plant)
    return float(nearest)


def test_the_adjoint_is_the_central_difference_away_from_the_switches() -> None:
    rng = np.random.default_rng(0)
    nudge, checked = 1e-6, 0
    while checked < 200:
        system = random_system(rng)
        problem = Problem(rng.uniform(-1, 1, 2), np.zeros(2), system, horizon=24)
        scale = system.control_limit * rng.choice([0.3, 1.0])
        controls = np.repeat(rng.uniform(-scale, scale, 6), 4)
        if distance_to_a_switch(problem, controls) < 100 * nudge:
            continue
        checked += 1
        state, jacobian = terminal_jacobian(problem, controls)
        nudges = nudge * np.eye(problem.horizon)
        ahead = rollout(system, problem.initial_state, controls + nudges)[:, -1]
        behind = rollout(system, problem.initial_state, controls - nudges)[:, -1]
        np.testing.assert_allclose(jacobian.T, (ahead - behind) / (2 * nudge), atol=1e-8)
        reached = rollout(system, problem.initial_state, controls[np.newaxis])[0, -1]
        np.testing.assert_array_equal(state, reached)


def test_a_stuck_mass_has_no_sensitivity() -> None:
    problem = Problem(np.zeros(2), np.zeros(2), System())

    _, jacobian = terminal_jacobian(problem, np.full(16, 0.5))

    np.testing.assert_array_equal(jacobian, 0)
