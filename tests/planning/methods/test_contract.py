"""What every method keeps to, and every optimiser: a new one is tested here by being added.

What is special to one of them is in its own file.
"""

import math
from dataclasses import fields
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import (
    CEM,
    ICEM,
    METHODS,
    MPPI,
    OPTIMISERS,
    ActionDiffusion,
    AnyMethod,
    AnyOptimiser,
    Uniform,
    WarmStarted,
)
from app.planning.methods.base import Method
from app.planning.methods.optimiser import Optimiser, score
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.system import ControlLimits, System
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.stop import NEVER, Stop
from tests.planning.fakes import EVERY_METHOD, LEARNED, Unwanted, assert_stops, stopped

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))


def name_of(method: Method) -> str:
    return f"warm-started {method.name}" if isinstance(method, WarmStarted) else method.name


every_method = pytest.mark.parametrize(
    "method",
    EVERY_METHOD + [WarmStarted(kind(iterations=3), LEARNED) for kind in OPTIMISERS],
    ids=name_of,
)
every_optimiser = pytest.mark.parametrize("kind", OPTIMISERS, ids=lambda kind: kind().name)
smallest_populations = pytest.mark.parametrize("num_candidates", [1, 2, 3])


def planned(
    method: Method, num_candidates: int = 24, seed: int = 0, problem: Problem = TASK
) -> Plan:
    return plan(problem, Recipe(method, num_candidates), np.random.default_rng(seed))


def mean_error(method: Method, num_candidates: int) -> float:
    errors = [planned(method, num_candidates, seed).terminal_error for seed in range(10)]
    return float(np.mean(errors))


@every_method
def test_the_same_seed_gives_the_same_candidates_and_another_one_others(method: Method) -> None:
    one, same, other = (planned(method, seed=seed).candidates for seed in (5, 5, 6))

    np.testing.assert_array_equal(one.controls, same.controls)
    np.testing.assert_array_equal(one.terminal_errors, same.terminal_errors)
    assert not np.array_equal(one.controls, other.controls)


@every_method
@pytest.mark.parametrize("system", [System(), System(control_limit=2.5, static_friction=1.2)])
def test_controls_keep_to_the_limit_of_the_plant_and_use_it(method: Method, system: System) -> None:
    problem = Problem(np.zeros(2), np.array([0.4, 0.0]), system)

    largest = np.max(np.abs(planned(method, problem=problem).candidates.controls))

    limit = system.plant.highest_control
    assert 0.9 * limit < largest <= limit


@every_method
@pytest.mark.parametrize(("lower", "upper"), [(-0.4, 2.0), (-2.0, 0.1), (0.0, 2.0), (0.5, 2.0)])
def test_controls_keep_to_the_limits_of_each_side(
    method: Method, lower: float, upper: float
) -> None:
    system = System(control_limit=ControlLimits(lower, upper), control_gain=0.5, bias=-0.2)
    problem = Problem(np.zeros(2), np.array([0.1, 0.0]), system)

    controls = planned(method, problem=problem).candidates.controls

    assert controls.min() >= lower
    assert controls.max() <= upper
    assert np.ptp(controls) > 0.4 * (upper - lower)


@every_method
@smallest_populations
@pytest.mark.parametrize("horizon", [1, 2, 7, 96])
def test_any_horizon_and_the_smallest_populations_work(
    method: Method, num_candidates: int, horizon: int
) -> None:
    problem = Problem(np.zeros(2), np.ones(2), horizon=horizon)
    proposal = method.propose(problem, num_candidates, np.random.default_rng(0))
    result = planned(method, num_candidates, problem=problem)

    assert proposal.controls.shape == (num_candidates, horizon)
    assert proposal.controls.dtype == np.float64
    assert result.controls.shape == (horizon,)
    assert result.states.shape == (horizon + 1, 2)
    assert result.candidates.controls.shape == (num_candidates, horizon)
    assert np.all(np.isfinite(result.candidates.controls))


@every_method
@settings(max_examples=15)
@given(
    states=st.lists(st.floats(-3, 3), min_size=4, max_size=4),
    static_friction=st.floats(0.1, 1.5),
    seed=st.integers(0, 2**32),
)
def test_plans_are_finite_wherever_they_start_and_end(
    method: Method, states: list[float], static_friction: float, seed: int
) -> None:
    system = System(static_friction=static_friction, coulomb_friction=0.8 * static_friction)
    problem = Problem(np.array(states[:2]), np.array(states[2:]), system, 16)

    result = planned(method, 4, seed, problem)

    assert np.all(np.isfinite(result.candidates.states))
    assert result.terminal_error == result.candidates.terminal_errors.min()
    assert 0 <= result.stuck_steps <= 16
    np.testing.assert_array_equal(result.states[0], states[:2])


@every_method
@pytest.mark.parametrize("num_candidates", [1, 7, 64])
def test_the_cost_is_what_it_rolls_out(
    method: Method, num_candidates: int, rolled_out: list[FloatArray]
) -> None:
    method.propose(TASK, num_candidates, np.random.default_rng(0))

    assert method.cost(num_candidates).rollouts == sum(map(len, rolled_out))


@every_method
def test_a_stop_that_nobody_sets_changes_nothing(method: Method) -> None:
    usual, stoppable = (
        method.propose(TASK, 6, np.random.default_rng(0), stop) for stop in (NEVER, Stop())
    )

    np.testing.assert_array_equal(stoppable.controls, usual.controls)


@every_method
def test_a_plan_that_is_not_wanted_from_the_start_is_not_begun(method: Method) -> None:
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    reason = Unwanted()

    with pytest.raises(Unwanted) as raised:
        plan(TASK, Recipe(method, 8), rng, stopped(reason))

    assert raised.value is reason
    assert rng.bit_generator.state == before


# Of each option, numbers just out of its range.
IMPOSSIBLE: dict[type[AnyMethod], dict[str, tuple[float, ...]]] = {
    ActionDiffusion: {"steps": (0, 1001), "guidance_scale": (-0.1, 20.1)},
    CEM: {
        "iterations": (0, 1001),
        "elite_fraction": (0.0, 1.1),
        "initial_std": (0.0, 10.1),
        "min_std": (-0.1,),
    },
    ICEM: {
        "iterations": (0, 1001),
        "elite_fraction": (0.0, 0.6),
        "noise_exponent": (-0.1, 10.1),
        "population_decay": (0.9, 10.1),
        "kept_elite_fraction": (-0.1, 1.1),
        "momentum": (-0.1, 1.0),
        "initial_std": (0.0, 10.1),
    },
    MPPI: {
        "iterations": (0, 1001),
        "noise_std": (0.0, 10.1),
        "noise_exponent": (-1.0, 10.1),
        "temperature": (0.0, 1.1e6),
        "smoothing_window": (-1, 0, 1025),
    },
}


@pytest.mark.parametrize("kind", METHODS, ids=lambda kind: kind().name)
def test_impossible_options_are_refused_by_name(kind: type[AnyMethod]) -> None:
    hints = {name: {hint, *get_args(hint)} for name, hint in get_type_hints(kind).items()}
    numbers = {option.name for option in fields(kind) if {int, float} & hints[option.name]}
    impossible = IMPOSSIBLE.get(kind, {})
    assert set(impossible) == numbers

    for name, values in impossible.items():
        for value in (*values, math.nan, math.inf, -math.inf):
            options: dict[str, Any] = {name: value}
            with pytest.raises(ValueError, match=name):
                kind(**options)


@every_optimiser
def test_iterations_and_candidates_improve_the_plan(kind: type[AnyOptimiser]) -> None:
    one, ten, forty = (mean_error(kind(iterations=n), 64) for n in (1, 10, 40))

    assert forty < 0.7 * ten
    assert ten < one
    assert mean_error(kind(iterations=10), 256) < mean_error(kind(iterations=10), 16)


@every_optimiser
def test_it_beats_uniform_shooting_with_the_same_number_of_rollouts(
    kind: type[AnyOptimiser],
) -> None:
    rollouts = Recipe(kind(), 64).cost().rollouts

    assert mean_error(kind(), 64) < 0.5 * mean_error(Uniform(), rollouts)


@every_optimiser
@pytest.mark.parametrize(
    "problem",
    [
        Problem(np.zeros(2), np.array([-0.2, 0.0]), horizon=40),
        Problem(np.zeros(2), np.array([-0.5, 0.0])),
        Problem(np.zeros(2), np.array([1.0, 0.0]), horizon=99),
        Problem(np.zeros(2), np.array([1.0, 0.0]), horizon=100),
        Problem(np.array([0.3, 0.4]), np.array([0.6, 0.0])),
        Problem(
            np.zeros(2),
            np.array([0.5, 0.0]),
            System(static_friction=0.3, coulomb_friction=0.2, control_limit=1.0),
        ),
    ],
    ids=["short", "mirrored", "odd", "long", "moving", "slippery"],
)
def test_other_starts_horizons_and_plants_are_solved(
    kind: type[AnyOptimiser], problem: Problem
) -> None:
    assert planned(kind(iterations=80), 256, problem=problem).terminal_error < 0.01


@every_optimiser
def test_the_best_of_everything_rolled_out_is_returned(
    kind: type[AnyOptimiser], rolled_out: list[FloatArray]
) -> None:
    proposal = kind(iterations=10).propose(TASK, 16, np.random.default_rng(0))

    everything = score(TASK, np.concatenate(rolled_out))
    assert score(TASK, proposal.controls).errors.min() == everything.errors.min()
    if kind.candidates is Optimiser.candidates:
        np.testing.assert_array_equal(proposal.controls, everything.best(16).controls)


@every_optimiser
def test_without_a_first_population_improving_is_proposing(kind: type[AnyOptimiser]) -> None:
    proposed = kind(iterations=8).propose(TASK, 16, np.random.default_rng(3))
    improved = kind(iterations=8).improve(TASK, 16, np.random.default_rng(3), None)

    np.testing.assert_array_equal(proposed.controls, improved.controls)


@every_optimiser
def test_the_first_population_is_left_as_it_was(kind: type[AnyOptimiser]) -> None:
    controls = np.random.default_rng(0).uniform(-0.9, 0.9, (16, 64))
    before = controls.copy()

    kind(iterations=8).improve(TASK, 16, np.random.default_rng(0), controls)

    np.testing.assert_array_equal(controls, before)


@every_optimiser
@pytest.mark.parametrize("shape", [(31, 64), (32, 63), (0, 64)])
def test_a_first_population_of_another_shape_is_refused(
    kind: type[AnyOptimiser], shape: tuple[int, int]
) -> None:
    with pytest.raises(ValueError, match="first population"):
        kind().improve(TASK, 32, np.random.default_rng(0), np.zeros(shape))


@every_optimiser
@pytest.mark.parametrize("is_first_given", [False, True])
def test_an_optimiser_that_is_stopped_before_its_first_iteration_stops(
    kind: type[AnyOptimiser], is_first_given: bool
) -> None:
    first = np.zeros((8, 64)) if is_first_given else None

    with pytest.raises(Unwanted):
        kind().improve(TASK, 8, np.random.default_rng(0), first, stopped())


class StopsAtDraw(np.random.Generator):
    """Sets a stop when it is asked for the n-th array of normal numbers."""

    def __init__(self, stop: Stop, draw: int) -> None:
        super().__init__(np.random.PCG64(0))
        self.draws = 0
        self._stop, self._draw = stop, draw

    def standard_normal(self, *args: Any, **options: Any) -> Any:
        self.draws += 1
        if self.draws == self._draw:
            self._stop.set(Unwanted())
        return super().standard_normal(*args, **options)


@every_optimiser
@pytest.mark.parametrize("draw", [1, 2, 7])
def test_a_stop_ends_the_iterations_at_once(kind: type[AnyOptimiser], draw: int) -> None:
    stop = Stop()
    rng = StopsAtDraw(stop, draw)
    optimiser: Optimiser[Any] = kind(iterations=1000)

    with pytest.raises(Unwanted):
        Optimiser.improve(optimiser, TASK, 8, rng, None, stop)

    assert rng.draws == draw


@every_optimiser
def test_a_stop_from_another_thread_ends_an_optimiser_that_runs(kind: type[AnyOptimiser]) -> None:
    problem = Problem(np.array([0.1, 0.2]), np.array([1e3, 0.5]), horizon=1024)
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state

    assert_stops(
        lambda stop: kind(iterations=1000).propose(problem, 2400, rng, stop),
        lambda: rng.bit_generator.state != before,
    )
