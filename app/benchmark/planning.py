"""Rollouts beside NumPy, CEM, and refined plans, in this process."""

from collections.abc import Iterator
from statistics import median, quantiles
from time import perf_counter

import numpy as np

from app.benchmark.pairing import paired
from app.planning.arrays import FloatArray
from app.planning.control import PD, AnyController, RecedingHorizon
from app.planning.control.memory import Memory
from app.planning.control.simulation import ToldOf, TrueMachine, simulate
from app.planning.control.step import Goal, Measurement, control_step
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
STEPS, RUNS = 64, 50
CONTROLLERS: dict[str, AnyController] = {
    "nominal": RecedingHorizon(observer=None),
    "identifying": RecedingHorizon(),
    "identifying, least energy": RecedingHorizon(objective="control_energy"),
    "PD, for comparison": PD(observer=None),
}
OFF_BY_TEN_PERCENT = System(0.77, 0.66, 0.055, control_gain=0.97)


def planning() -> Iterator[str]:
    """Measure what needs no network; yield a Markdown list."""
    yield _rollouts()
    yield _cem()
    yield _refined()
    for name, controller in CONTROLLERS.items():
        yield _control(name, controller)


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


def _control(name: str, controller: AnyController) -> str:
    """Drive a mass that is off from its model to random targets, a step at a time."""
    rng = np.random.default_rng(0)
    model, times = System(), []
    targets = rng.uniform(-0.5, 0.5, RUNS).tolist()
    for target in targets:
        memory: Memory | None = None
        state = np.zeros(2)
        for k in range(STEPS):
            measurement = Measurement(*state.tolist())
            started = perf_counter()
            taken = control_step(controller, model, measurement, Goal(target, STEPS - k), memory)
            times.append((perf_counter() - started) * 1e6)
            memory = taken.memory
            state = rollout(OFF_BY_TEN_PERCENT, state, np.array([[taken.control]]))[0, -1]
    started = perf_counter()
    for target in targets:
        told = ToldOf(model, target, STEPS)
        simulate(TrueMachine(OFF_BY_TEN_PERCENT), np.zeros(2), controller, told, STEPS, [0])
    within = (perf_counter() - started) * 1e6 / (RUNS * STEPS)
    percentiles = quantiles(times, n=100)
    return (
        f"- a step of a closed loop, {name}: median {median(times):.0f} us, p99 "
        f"{percentiles[-1]:.0f} us called one by one; {within:.1f} us in whole runs"
    )
