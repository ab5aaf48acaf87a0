"""Plans out of the reachable set end on the floor, on any plant."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from app.planning.methods import DatasetPrior, Uniform
from app.planning.planner import plan
from app.planning.plant.machines import MACHINES
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, ControlLimits, System
from app.planning.problem import Problem
from app.planning.reachable.reachability import reachability
from app.planning.reachable.trace import trace
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement

PLANTS = {
    "the paper's": System(),
    "no friction": System(static_friction=0.0, coulomb_friction=0.0, viscous_damping=0.0),
    "limit at f_s": System(control_limit=0.7),
    "limit below f_s": System(control_limit=0.65),
    "f_c far below f_s": System(coulomb_friction=0.1),
    "no Coulomb friction": System(coulomb_friction=0.0),
    "f_s near the limit": System(static_friction=0.89),
    "hops": System(static_friction=0.89, velocity_threshold=0.05),
    "threshold 0.2": System(velocity_threshold=0.2),
    "threshold 0.5": System(velocity_threshold=0.5),
    "strong damping": System(viscous_damping=5.0),
    "damped within a step": System(viscous_damping=19.0),
    "strong": System(control_limit=9.0),
    "coarse": System(time_step=0.2),
    "fine": System(time_step=0.01),
    "large": System(700.0, 600.0, control_limit=900.0, velocity_threshold=1.0),
    "easier backward": System(ByDirection(0.7, 0.3), ByDirection(0.6, 0.2), ByDirection(0.1, 1.0)),
    "slope that holds": System(bias=0.5),
    "slope as steep as static friction": System(bias=0.7),
    "slope that has to be held": System(bias=-0.9),
    "slope that slips": System(bias=1.7),
    "bias at the limit": System(bias=0.9),
    "one way": System(control_limit=ControlLimits(0.0, 0.9), bias=-0.1),
    "always on": System(control_limit=ControlLimits(0.1, 2.0), bias=-0.8),
    "other units": System(control_gain=36.9, control_limit=0.05, bias=0.1),
    "Stribeck": System(1.2, 0.4, stribeck_velocity=0.05, control_limit=3.0),
    "slow Stribeck": System(0.7, 0.1, stribeck_velocity=0.5),
}
ILL_CONDITIONED = {"damped within a step": 1e-2}
"""Positions at the end of the set depend on the last digit of the velocity: descent mends that."""
plants = st.sampled_from(sorted(PLANTS))
velocities = st.one_of(st.just(0.0), st.floats(-1.0, 1.0))


def scaled_problem(plant: str, p0: float, v0: float, p1: float, v1: float, horizon: int) -> Problem:
    """Return a problem with states as large as the plant's controls, against 0.9."""
    scale = 1000.0 if plant == "large" else 1.0
    start, target = scale * np.array([p0, v0]), scale * np.array([p1, v1])
    return Problem(start, target, PLANTS[plant], horizon)


@given(
    plant=plants,
    p0=st.floats(-1.0, 1.0),
    v0=velocities,
    p1=st.floats(-1.0, 1.0),
    v1=velocities,
    horizon=st.integers(1, 64),
)
@example(plant="fine", p0=0.0, v0=0.0, p1=8e-7, v1=0.0, horizon=3)
@example(plant="fine", p0=0.0, v0=0.0, p1=0.0, v1=0.00390625, horizon=3)
def test_a_traced_plan_ends_on_the_floor(
    plant: str, p0: float, v0: float, p1: float, v1: float, horizon: int
) -> None:
    problem = scaled_problem(plant, p0, v0, p1, v1, horizon)
    bound, controls = trace(problem)

    assert controls.shape == (horizon,)
    plant_limits = problem.system.plant
    assert controls.min() >= plant_limits.lowest_control
    assert controls.max() <= plant_limits.highest_control
    end = rollout(problem.system, problem.initial_state, controls[np.newaxis])[0, -1]
    error = math.hypot(*(end - problem.target_state))
    scale = max(1.0, float(np.abs([problem.initial_state, problem.target_state]).max()))
    near = ILL_CONDITIONED.get(plant, 1e-6) * scale + bound.floor_error
    assert error == pytest.approx(bound.floor, abs=near)


@pytest.mark.parametrize(
    ("system", "start", "target"),
    [
        (System(static_friction=0.85), (0.43, 0.0), (0.1278, 0.0401)),
        (System(velocity_threshold=0.2), (-0.6691, 0.0), (0.6250, 0.0)),
        (System(control_limit=0.7), (0.1052, -0.9801), (-0.6399, -0.1623)),
        (System(control_limit=0.65), (0.0, -0.4342), (0.0, -0.4342)),
    ],
)
def test_a_refined_plan_ends_on_the_floor_where_descent_alone_did_not(
    system: System, start: tuple[float, float], target: tuple[float, float]
) -> None:
    problem = Problem(np.array(start), np.array(target), system)
    for method in (DatasetPrior(), Uniform()):
        recipe = Recipe(method, 16, Refinement())
        refined = plan(problem, recipe, np.random.default_rng(1))
        assert refined.terminal_error < reachability(problem).floor + 1e-8


def assert_refined_on_the_floor(problem: Problem, num_candidates: int, seed: int) -> None:
    recipe = Recipe(DatasetPrior(), num_candidates, Refinement(), reachability=True)

    result = plan(problem, recipe, np.random.default_rng(seed))

    assert result.gap is not None
    assert result.reachability is not None
    scale = max(1.0, float(np.abs([problem.initial_state, problem.target_state]).max()))
    assert result.gap <= 1e-6 * scale + result.reachability.floor_error


@given(
    plant=plants,
    p0=st.floats(-1.0, 1.0),
    v0=velocities,
    p1=st.floats(-1.0, 1.0),
    v1=velocities,
    seed=st.integers(0, 2**32 - 1),
)
def test_every_refined_plan_ends_on_the_floor(
    plant: str, p0: float, v0: float, p1: float, v1: float, seed: int
) -> None:
    assert_refined_on_the_floor(scaled_problem(plant, p0, v0, p1, v1, 64), 4, seed)


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
def test_every_refined_plan_of_hundreds_on_a_plant_ends_on_the_floor(plant: str) -> None:
    rng = np.random.default_rng(11)
    for seed in range(250):
        p0, p1 = rng.uniform(-1, 1, 2)
        v0, v1 = rng.uniform(-1, 1, 2) * rng.integers(0, 2, 2)
        assert_refined_on_the_floor(scaled_problem(plant, p0, v0, p1, v1, 64), 16, seed)


@pytest.mark.parametrize("machine", MACHINES)
def test_every_refined_plan_of_a_machine_ends_on_the_floor(machine: str) -> None:
    system = MACHINES[machine].system
    plant, rng = system.plant, np.random.default_rng(3)
    pushes = np.repeat([[plant.lowest_control], [plant.highest_control]], 64, axis=1)
    reach, speed = np.ptp(rollout(system, np.zeros(2), pushes)[:, -1], axis=0) / 2
    for seed in range(20):
        p1 = rng.uniform(-1, 1) * reach
        v0, v1 = rng.uniform(-0.5, 0.5, 2) * speed * rng.integers(0, 2, 2)
        problem = Problem(np.array([0.0, v0]), np.array([p1, v1]), system)
        assert_refined_on_the_floor(problem, 16, seed)
