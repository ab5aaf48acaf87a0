# ruff: noqa: ARG002 - a fake takes what the protocol gives it
from dataclasses import dataclass

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.methods import CEM, ICEM, MPPI, OPTIMISERS, ActionDiffusion, DatasetPrior, Started
from app.planning.methods.base import LearnedProposal, Method, Optimiser, score
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.rollout import rollout
from app.planning.problem import Candidates, Cost, PlanningError, Problem
from app.planning.stop import NEVER, Stop

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))

ONE_ITERATION: list[Optimiser] = [CEM(iterations=1), ICEM(iterations=1), MPPI(iterations=1)]
QUICK: list[Optimiser] = [CEM(iterations=8), ICEM(iterations=8), MPPI(iterations=8)]


@dataclass(frozen=True)
class Fixed:
    """An initial method that proposes given controls, bought with three evaluations."""

    controls: FloatArray
    name: str = "fixed"

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        return Candidates(self.controls, queue_ms=2.5)

    def cost(self, num_candidates: int) -> Cost:
        return Cost(network_evaluations=3, rollouts=num_candidates)


class NoiseAsControls:
    """A learned proposal that needs no network: the noise is the plan, often beyond the limit."""

    def sample(
        self, problem: Problem, noise: FloatArray, sampler: str, steps: int, guidance_scale: float
    ) -> Candidates:
        return Candidates(noise, queue_ms=1.5)


def solve(method: Method, problem: Problem = TASK, k: int = 32, seed: int = 0) -> Plan:
    return plan(problem, method, k, np.random.default_rng(seed), NoiseAsControls())


def rows(controls: FloatArray) -> set[tuple[float, ...]]:
    return set(map(tuple, controls))


quickly = pytest.mark.parametrize("optimiser", QUICK, ids=lambda optimiser: optimiser.name)
once = pytest.mark.parametrize("optimiser", ONE_ITERATION, ids=lambda optimiser: optimiser.name)


def test_every_optimiser_is_tested_here() -> None:
    assert {type(o) for o in QUICK} == {type(o) for o in ONE_ITERATION} == set(OPTIMISERS)


@once
def test_the_first_population_is_the_initial_one(optimiser: Optimiser) -> None:
    controls = np.random.default_rng(0).uniform(-0.9, 0.9, (32, 64))

    candidates = solve(Started(optimiser, Fixed(controls))).candidates.controls

    # MPPI has one more sequence to choose from, its nominal one.
    assert len(rows(candidates) - rows(controls)) <= (optimiser.name == "mppi")


@quickly
def test_an_exact_initial_candidate_is_never_lost(optimiser: Optimiser) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        controls = rng.uniform(-0.9, 0.9, (32, 64))
        controls[seed] = np.repeat([0.9, 0.0, -0.9, 0.0], [16, 16, 8, 24])
        reached = rollout(TASK.system, TASK.initial_state, controls[seed : seed + 1])[0, -1]
        problem = Problem(TASK.initial_state, reached)

        assert solve(Started(optimiser, Fixed(controls)), problem).terminal_error <= 1e-15


@quickly
@pytest.mark.parametrize("initial", [DatasetPrior(), ActionDiffusion()], ids=lambda m: m.name)
def test_it_is_never_worse_than_what_it_starts_from(optimiser: Optimiser, initial: Method) -> None:
    starts = [solve(initial, seed=seed) for seed in range(5)]
    plans = [solve(Started(optimiser, initial), seed=seed) for seed in range(5)]

    gains = [a.terminal_error - b.terminal_error for a, b in zip(starts, plans, strict=True)]
    assert min(gains) >= 0
    for improved in plans:
        assert np.all(np.abs(improved.candidates.controls) <= 0.9)
        assert improved.candidates.controls.shape == (32, 64)


@pytest.mark.parametrize("optimiser", [CEM, ICEM, MPPI])
def test_a_good_start_saves_iterations(optimiser: type[CEM | ICEM | MPPI]) -> None:
    def mean_error(method: Method) -> float:
        return float(np.mean([solve(method, seed=seed).terminal_error for seed in range(10)]))

    # Twelve centimetres off and scattered: what a learned proposal would offer.
    rough = np.repeat([0.9, -0.9, 0.0], [37, 8, 19])
    rough = rough + 0.2 * np.random.default_rng(0).standard_normal((32, 64))
    few = optimiser(iterations=2)

    assert mean_error(Started(few, Fixed(rough))) < 0.7 * mean_error(few)


@quickly
def test_without_initial_controls_improving_is_proposing(optimiser: Optimiser) -> None:
    proposed = optimiser.propose(TASK, 16, np.random.default_rng(3), None)
    improved = optimiser.improve(TASK, 16, np.random.default_rng(3), None)

    np.testing.assert_array_equal(proposed.controls, improved.controls)


@once
def test_initial_controls_are_clipped_to_the_limits(optimiser: Optimiser) -> None:
    controls = np.tile(np.linspace(-3.0, 3.0, 64), (4, 1))

    candidates = solve(Started(optimiser, Fixed(controls)), k=4).candidates.controls

    np.testing.assert_allclose(candidates, np.clip(controls, -0.9, 0.9), atol=1e-12)


@quickly
def test_the_initial_controls_are_left_as_they_were(optimiser: Optimiser) -> None:
    controls = np.random.default_rng(0).uniform(-0.9, 0.9, (16, 64))
    before = controls.copy()

    optimiser.improve(TASK, 16, np.random.default_rng(0), controls)

    np.testing.assert_array_equal(controls, before)


@quickly
@pytest.mark.parametrize("k", [1, 2])
def test_the_smallest_populations_work(optimiser: Optimiser, k: int) -> None:
    start = score(TASK, DatasetPrior().propose(TASK, k, np.random.default_rng(0), None).controls)
    improved = solve(Started(optimiser, DatasetPrior()), k=k)

    assert improved.candidates.controls.shape == (k, 64)
    assert improved.terminal_error <= start.errors.min()


@quickly
def test_the_same_seed_gives_the_same_plan(optimiser: Optimiser) -> None:
    one, same = (solve(Started(optimiser, DatasetPrior()), seed=4).controls for _ in range(2))

    np.testing.assert_array_equal(one, same)


@quickly
def test_the_cost_is_that_of_both(optimiser: Optimiser) -> None:
    method = Started(optimiser, Fixed(np.zeros((32, 64))))

    assert method.cost(32) == optimiser.cost(32) + Cost(network_evaluations=3, rollouts=32)


def test_it_goes_by_the_name_of_the_optimiser_and_passes_the_waiting_on() -> None:
    method = Started(QUICK[0], ActionDiffusion())

    assert method.name == "cem"
    assert solve(method).timing.queue == 1.5


@quickly
@pytest.mark.parametrize("shape", [(31, 64), (32, 63), (0, 64)])
def test_initial_controls_of_another_shape_are_refused(
    optimiser: Optimiser, shape: tuple[int, int]
) -> None:
    with pytest.raises(ValueError, match="initial controls"):
        solve(Started(optimiser, Fixed(np.zeros(shape))))


@quickly
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_initial_controls_that_are_not_finite_are_refused(optimiser: Optimiser, bad: float) -> None:
    with pytest.raises(PlanningError, match="fixed proposed controls that are not finite"):
        solve(Started(optimiser, Fixed(np.full((32, 64), bad))))
