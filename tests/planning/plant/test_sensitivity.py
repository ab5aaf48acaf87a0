"""The derivative of the terminal state, held against differences of rollouts."""

from dataclasses import replace

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.friction import resting_controls, take_step
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
    plant = problem.system.plant
    resting = resting_controls(plant)
    position, velocity = problem.initial_state
    nearest = np.inf
    for control in controls:
        nearest = min(nearest, abs(abs(velocity) - plant.velocity_threshold))
        if abs(velocity) < plant.velocity_threshold:
            nearest = min(nearest, abs(control - resting.low), abs(control - resting.high))
        else:
            nearest = min(nearest, abs(take_step(velocity, control, plant).free_velocity))
        position, velocity = step(position, velocity, control, plant)
    return float(nearest)


def test_the_adjoint_is_the_central_difference_away_from_the_switches() -> None:
    rng = np.random.default_rng(0)
    nudge, checked = 1e-6, 0
    while checked < 200:
        system = random_system(rng)
        if rng.random() < 0.3:
            system = replace(system, stribeck_velocity=10 ** rng.uniform(-1.5, 0))
        problem = Problem(rng.uniform(-1, 1, 2), np.zeros(2), system, horizon=24)
        plant, scale = system.plant, rng.choice([0.3, 1.0])
        levels = rng.uniform(scale * plant.lowest_control, scale * plant.highest_control, 6)
        controls = np.repeat(levels, 4)
        if distance_to_a_switch(problem, controls) < 100 * nudge:
            continue
        checked += 1
        state, jacobian = terminal_jacobian(problem, controls)
        nudges = nudge * np.eye(problem.horizon)
        ahead = rollout(system, problem.initial_state, controls + nudges)[:, -1]
        behind = rollout(system, problem.initial_state, controls - nudges)[:, -1]
        np.testing.assert_allclose(jacobian.T, (ahead - behind) / (2 * nudge), atol=1e-7)
        reached = rollout(system, problem.initial_state, controls[np.newaxis])[0, -1]
        np.testing.assert_array_equal(state, reached)


def test_a_stuck_mass_has_no_sensitivity() -> None:
    problem = Problem(np.zeros(2), np.zeros(2), System())

    _, jacobian = terminal_jacobian(problem, np.full(16, 0.5))

    np.testing.assert_array_equal(jacobian, 0)
