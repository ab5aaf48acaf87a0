"""Warm starts: an optimiser keeps what is good in the candidates that it starts from."""

from typing import Any

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.methods import OPTIMISERS, ActionDiffusion, AnyOptimiser, DatasetPrior
from app.planning.methods.base import Method
from app.planning.methods.optimiser import Optimiser
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS
from app.planning.methods.warm_started import WarmStarted
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.rollout import rollout
from app.planning.problem import Cost, PlanningError, Problem
from app.planning.recipe import Recipe
from tests.planning.fakes import LEARNED, Fixed

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))
QUICK: list[Optimiser[Any]] = [kind(iterations=8) for kind in OPTIMISERS]
ONE_ITERATION: list[Optimiser[Any]] = [kind(iterations=1) for kind in OPTIMISERS]


def solve(method: Method, problem: Problem = TASK, k: int = 32, seed: int = 0) -> Plan:
    return plan(problem, Recipe(method, k), np.random.default_rng(seed))


def rows(controls: FloatArray) -> set[tuple[float, ...]]:
    return set(map(tuple, controls))


quickly = pytest.mark.parametrize("optimiser", QUICK, ids=lambda optimiser: optimiser.name)
once = pytest.mark.parametrize("optimiser", ONE_ITERATION, ids=lambda optimiser: optimiser.name)


@once
def test_the_first_population_is_the_initial_one(optimiser: Optimiser[Any]) -> None:
    controls = np.random.default_rng(0).uniform(-0.9, 0.9, (32, 64))

    candidates = solve(WarmStarted(optimiser, Fixed(controls))).candidates.controls

    # MPPI has one more sequence to choose from, its nominal one.
    assert len(rows(candidates) - rows(controls)) <= (optimiser.name == "mppi")


@quickly
def test_an_exact_initial_candidate_is_never_lost(optimiser: Optimiser[Any]) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        controls = rng.uniform(-0.9, 0.9, (32, 64))
        controls[seed] = np.repeat([0.9, 0.0, -0.9, 0.0], [16, 16, 8, 24])
        reached = rollout(TASK.system, TASK.initial_state, controls[seed : seed + 1])[0, -1]
        problem = Problem(TASK.initial_state, reached)

        assert solve(WarmStarted(optimiser, Fixed(controls)), problem).terminal_error <= 1e-15


@quickly
@pytest.mark.parametrize("initial", [DatasetPrior(), LEARNED], ids=lambda m: m.name)
@pytest.mark.parametrize("k", [1, 2, 32])
def test_it_is_never_worse_than_what_it_starts_from(
    optimiser: Optimiser[Any], initial: Method, k: int
) -> None:
    starts = [solve(initial, k=k, seed=seed) for seed in range(5)]
    plans = [solve(WarmStarted(optimiser, initial), k=k, seed=seed) for seed in range(5)]

    gains = [a.terminal_error - b.terminal_error for a, b in zip(starts, plans, strict=True)]
    assert min(gains) >= 0
    for improved in plans:
        assert np.all(np.abs(improved.candidates.controls) <= 0.9)
        assert improved.candidates.controls.shape == (k, 64)


@pytest.mark.parametrize("kind", OPTIMISERS, ids=lambda kind: kind().name)
def test_a_good_start_saves_iterations(kind: type[AnyOptimiser]) -> None:
    def mean_error(method: Method) -> float:
        return float(np.mean([solve(method, seed=seed).terminal_error for seed in range(10)]))

    # Twelve centimetres off and scattered: what a learned proposal would offer.
    rough = np.repeat([0.9, -0.9, 0.0], [37, 8, 19])
    rough = rough + 0.2 * np.random.default_rng(0).standard_normal((32, 64))
    few = kind(iterations=2)

    assert mean_error(WarmStarted(few, Fixed(rough))) < 0.7 * mean_error(few)


@once
def test_initial_controls_are_clipped_to_the_limits(optimiser: Optimiser[Any]) -> None:
    controls = np.tile(np.linspace(-3.0, 3.0, 64), (4, 1))

    candidates = solve(WarmStarted(optimiser, Fixed(controls)), k=4).candidates.controls

    np.testing.assert_allclose(candidates, np.clip(controls, -0.9, 0.9), atol=1e-12)


@quickly
def test_the_cost_is_that_of_both(optimiser: Optimiser[Any]) -> None:
    method = WarmStarted(optimiser, Fixed(np.zeros((32, 64))))

    assert method.cost(32) == optimiser.cost(32) + Cost(network_evaluations=3, rollouts=320)


def test_it_goes_by_the_name_of_the_optimiser_and_passes_the_waiting_on() -> None:
    method = WarmStarted(QUICK[0], LEARNED)

    assert method.name == QUICK[0].name
    assert solve(method).timing.queue == 2.5


def test_its_cost_is_known_before_the_initial_method_has_its_model() -> None:
    sampler = ActionDiffusion().settled(PAPER_MODEL_SAMPLERS)

    assert WarmStarted(QUICK[0], sampler).cost(32) == sampler.cost(32) + QUICK[0].cost(32)


@quickly
@pytest.mark.parametrize("shape", [(31, 64), (32, 63), (0, 64)])
def test_initial_controls_of_another_shape_are_refused(
    optimiser: Optimiser[Any], shape: tuple[int, int]
) -> None:
    with pytest.raises(ValueError, match="first population"):
        solve(WarmStarted(optimiser, Fixed(np.zeros(shape))))


@quickly
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_initial_controls_that_are_not_finite_are_refused(
    optimiser: Optimiser[Any], bad: float
) -> None:
    with pytest.raises(PlanningError, match="fixed proposed controls that are not finite"):
        solve(WarmStarted(optimiser, Fixed(np.full((32, 64), bad))))
