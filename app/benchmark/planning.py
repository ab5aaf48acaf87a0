"""Rollouts beside NumPy, CEM, and refined plans, in this process."""

from collections.abc import Iterator
from statistics import median
from time import perf_counter

import numpy as np

from app.benchmark.pairing import paired
from app.planning.arrays import FloatArray
from app.planning.methods import CEM, DatasetPrior
from app.planning.planner import plan
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement

PAIRS = 200
TASKS = 1000
EXACT_GAP = 1e-6


def planning() -> Iterator[str]:
    """Measure what needs no network; yield a Markdown list."""
    yield _rollouts()
    yield _cem()
    yield _refined()


def numpy_rollout(system: System, initial_state: FloatArray, controls: FloatArray) -> FloatArray:
    """Roll out `controls` (K, H) with NumPy, vectorised over K; return the states (K, H+1, 2).

    For a plant that is the same both ways, as the paper's is: NumPy gets no more to do than it has.
    """
    plant = system.plant
    num_candidates, horizon = controls.shape
    states = np.empty((num_candidates, horizon + 1, 2))
    states[:, 0] = initial_state
    position, velocity = states[:, 0, 0].copy(), states[:, 0, 1].copy()
    for k in range(horizon):
        control = controls[:, k]
        at_rest = np.abs(velocity) < plant.velocity_threshold
        friction = plant.coulomb_forward * np.sign(np.where(at_rest, control, velocity))
        drag = np.where(at_rest, 0.0, plant.damping_forward * velocity)
        following = velocity + plant.time_step * (control - friction - drag)
        reversed_ = ~at_rest & (following * velocity < 0)
        stuck = at_rest & (np.abs(control) <= plant.static_forward)
        velocity = np.where(reversed_ | stuck, 0.0, following)
        position = position + plant.time_step * velocity
        states[:, k + 1, 0], states[:, k + 1, 1] = position, velocity
    return states


def _rollouts() -> str:
    system, start = System(), np.zeros(2)
    controls = np.random.default_rng(0).uniform(-0.9, 0.9, (512, 64))
    kernel, reference = (f(system, start, controls) for f in (rollout, numpy_rollout))
    if not np.allclose(kernel, reference, atol=1e-12):
        raise AssertionError("the kernel and the NumPy reference disagree")
    compiled, vectorised = paired(
        lambda: rollout(system, start, controls),
        lambda: numpy_rollout(system, start, controls),
        PAIRS,
    )
    return (
        f"- rollouts of (512, 64): compiled {compiled:.3f} ms, NumPy {vectorised:.3f} ms, "
        f"ratio {vectorised / compiled:.0f}"
    )


def _cem() -> str:
    problem, rng = Problem(np.zeros(2), np.array([0.5, 0.0])), np.random.default_rng(0)
    large, small = paired(
        lambda: plan(problem, Recipe(CEM(), 512), rng),
        lambda: plan(problem, Recipe(CEM(), 16), rng),
        PAIRS,
    )
    return f"- cem, 40 iterations: {large:.1f} ms a plan with K = 512, {small:.2f} ms with K = 16"


def _refined() -> str:
    """Plan random tasks: starts in the training range, targets at rest in [-1, 1] m."""
    rng = np.random.default_rng(0)
    recipe = Recipe(DatasetPrior(), 16, Refinement(), reachability=True)
    plans = []
    times = []
    for _ in range(TASKS):
        start = np.array([rng.uniform(-1, 1), rng.uniform(-0.5, 0.5)])
        problem = Problem(start, np.array([rng.uniform(-1, 1), 0.0]))
        started = perf_counter()
        plans.append(plan(problem, recipe, rng))
        times.append((perf_counter() - started) * 1e3)
    reachable = np.array(
        [refined.reachability.reachable for refined in plans if refined.reachability]
    )
    gaps = np.array([refined.gap for refined in plans])
    return (
        f"- dataset_prior with K = 16, refined, {TASKS} tasks: {median(times):.2f} ms a plan; "
        f"{np.mean(gaps[reachable] < EXACT_GAP):.2%} of the {reachable.sum()} reachable targets "
        f"within 1e-6, the others on average {gaps[~reachable].mean():.0e} from their floor"
    )
