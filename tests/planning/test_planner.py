# ruff: noqa: ARG002 - a fake takes what the protocol gives it

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import CEM, ICEM, METHODS, MPPI, ActionDiffusion, DatasetPrior, Uniform
from app.planning.methods.base import LearnedProposal, Method
from app.planning.metrics import control_energy, control_smoothness, stuck_steps
from app.planning.objectives import Objective
from app.planning.plan import MultistepPlan, Plan
from app.planning.planner import plan, plan_cost, plan_multistep
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import (
    Candidates,
    Cost,
    PlanningError,
    Problem,
    as_state,
)
from app.planning.refining.refinement import Refinement
from app.planning.stop import NEVER, Stop

SYSTEM = System()
PROBLEM = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]))
EVERY_METHOD: list[Method] = [
    ActionDiffusion(),
    DatasetPrior(),
    Uniform(),
    CEM(iterations=3),
    ICEM(iterations=3),
    MPPI(iterations=3),
]
TARGETS = [np.array([0.4, 0.0]), np.array([-0.4, 0.0]), np.array([0.2, 0.0])]


class NoiseAsControls:
    """A learned proposal that needs no network: the noise is the plan, often beyond the limit."""

    def sample(
        self, problem: Problem, noise: FloatArray, sampler: str, steps: int, guidance_scale: float
    ) -> Candidates:
        return Candidates(noise, queue_ms=2.5)


@dataclass
class Fixed:
    """A method that proposes given controls."""

    controls: FloatArray
    name: str = "fixed"
    problems: list[Problem] = field(default_factory=list)

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        self.problems.append(problem)
        return Candidates(self.controls)

    def cost(self, num_candidates: int) -> Cost:
        return Cost(network_evaluations=3, rollouts=10 * num_candidates)


def plan_with(method: Method, problem: Problem = PROBLEM, seed: int = 0, k: int = 24) -> Plan:
    return plan(problem, method, k, np.random.default_rng(seed), NoiseAsControls())


def multistep(method: Method, seed: int = 0, k: int = 24) -> MultistepPlan:
    rng = np.random.default_rng(seed)
    return plan_multistep(np.zeros(2), TARGETS, SYSTEM, 32, method, k, rng, NoiseAsControls())


by_name = pytest.mark.parametrize("method", EVERY_METHOD, ids=lambda method: method.name)


def test_every_method_of_the_service_is_tested_here() -> None:
    assert {type(method) for method in EVERY_METHOD} == set(METHODS)


@by_name
def test_the_plan_is_the_rollout_of_its_own_controls(method: Method) -> None:
    result = plan_with(method)

    states = rollout(SYSTEM, PROBLEM.initial_state, result.controls[None])[0]
    np.testing.assert_array_equal(result.states, states)
    error = math.dist(states[-1], PROBLEM.target_state)
    assert result.terminal_error == pytest.approx(error, rel=1e-14)
    assert result.control_energy == control_energy(result.controls)
    assert result.control_smoothness == control_smoothness(result.controls)
    assert result.stuck_steps == stuck_steps(states, result.controls, 0.4, SYSTEM)


@by_name
def test_the_candidates_are_the_rollouts_of_their_own_controls(method: Method) -> None:
    candidates = plan_with(method).candidates

    assert candidates.controls.shape == (24, 64)
    np.testing.assert_array_equal(
        candidates.states, rollout(SYSTEM, PROBLEM.initial_state, candidates.controls)
    )
    np.testing.assert_allclose(
        candidates.terminal_errors,
        [math.dist(state, PROBLEM.target_state) for state in candidates.states[:, -1]],
        rtol=1e-14,
    )


@by_name
def test_the_plan_is_the_best_of_its_candidates(method: Method) -> None:
    result = plan_with(method)

    best = int(np.argmin(result.candidates.terminal_errors))
    assert result.terminal_error == result.candidates.terminal_errors[best]
    np.testing.assert_array_equal(result.controls, result.candidates.controls[best])
    np.testing.assert_array_equal(result.states, result.candidates.states[best])


@by_name
def test_the_same_seed_gives_the_same_plan(method: Method) -> None:
    first, again, other = (plan_with(method, seed=seed) for seed in (5, 5, 6))

    np.testing.assert_array_equal(first.candidates.controls, again.candidates.controls)
    assert first.terminal_error == again.terminal_error
    assert not np.array_equal(first.candidates.controls, other.candidates.controls)


@by_name
@pytest.mark.parametrize("system", [SYSTEM, System(control_limit=2.5, static_friction=1.2)])
def test_controls_keep_to_the_limit_of_the_plant_and_use_it(method: Method, system: System) -> None:
    problem = Problem(np.zeros(2), np.array([0.4, 0.0]), system)

    largest = np.max(np.abs(plan_with(method, problem).candidates.controls))

    assert 0.9 * system.control_limit < largest <= system.control_limit


@by_name
@pytest.mark.parametrize("horizon", [1, 7, 96])
def test_any_horizon_and_a_single_candidate_work(method: Method, horizon: int) -> None:
    result = plan_with(method, Problem(np.zeros(2), np.ones(2), SYSTEM, horizon), k=1)

    assert result.controls.shape == (horizon,)
    assert result.states.shape == (horizon + 1, 2)
    assert result.candidates.controls.shape == (1, horizon)


@by_name
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

    result = plan_with(method, problem, seed, k=4)

    assert np.all(np.isfinite(result.candidates.states))
    assert result.terminal_error == result.candidates.terminal_errors.min()
    assert 0 <= result.stuck_steps <= 16
    np.testing.assert_array_equal(result.states[0], states[:2])


def test_proposals_beyond_the_limit_are_clipped_before_they_are_rolled_out() -> None:
    proposed = np.array([[5.0] * 64, [-5.0] * 64, [0.3] * 64])

    result = plan_with(Fixed(proposed), k=3)

    np.testing.assert_array_equal(
        result.candidates.controls, np.array([[0.9] * 64, [-0.9] * 64, [0.3] * 64])
    )
    np.testing.assert_array_equal(
        result.candidates.states,
        rollout(SYSTEM, PROBLEM.initial_state, result.candidates.controls),
    )


def test_the_candidates_keep_the_order_of_the_proposal() -> None:
    proposed = np.linspace(-0.9, 0.9, 5)[:, None].repeat(64, axis=1)

    np.testing.assert_array_equal(plan_with(Fixed(proposed), k=5).candidates.controls, proposed)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_proposal_that_is_not_finite_is_an_error_that_names_the_method(value: float) -> None:
    proposed = np.zeros((4, 64))
    proposed[2, 10] = value

    with pytest.raises(PlanningError, match="fixed"):
        plan_with(Fixed(proposed), k=4)


def test_a_plan_counts_its_own_rollouts_on_top_of_the_proposal() -> None:
    assert plan_with(Fixed(np.zeros((4, 64))), k=4).cost == Cost(3, 44)
    assert plan_with(Uniform(), k=16).cost == Cost(0, 16)
    assert plan_with(CEM(iterations=5), k=16).cost == Cost(0, 96)
    assert plan_with(ActionDiffusion(steps=50), k=16).cost == Cost(100, 16)


@by_name
def test_the_cost_is_known_before_it_is_spent(method: Method) -> None:
    assert plan_cost(method, 24) == plan_with(method).cost


def test_the_wait_of_the_proposal_is_reported_as_queueing() -> None:
    timing = plan_with(ActionDiffusion()).timing

    assert timing.queue == 2.5
    assert timing.total == pytest.approx(
        timing.queue + timing.propose + timing.refine + timing.rollout
    )


@by_name
def test_each_segment_starts_exactly_where_the_one_before_ended(method: Method) -> None:
    segments = multistep(method).segments

    assert len(segments) == 3
    np.testing.assert_array_equal(segments[0].states[0], [0.0, 0.0])
    for before, after in pairwise(segments):
        np.testing.assert_array_equal(before.states[-1], after.states[0])


@by_name
def test_the_composed_plan_is_one_rollout_of_the_composed_controls(method: Method) -> None:
    result = multistep(method)

    assert result.controls.shape == (96,)
    np.testing.assert_array_equal(
        result.controls, np.concatenate([segment.controls for segment in result.segments])
    )
    np.testing.assert_array_equal(
        result.states, rollout(SYSTEM, np.zeros(2), result.controls[None])[0]
    )


@by_name
def test_multistep_errors_are_those_at_the_ends_of_the_segments(method: Method) -> None:
    result = multistep(method)

    ends = result.states[[32, 64, 96]]
    errors = [math.dist(end, target) for end, target in zip(ends, TARGETS, strict=True)]
    assert result.mean_end_error == pytest.approx(np.mean(errors), rel=1e-14)
    assert result.final_error == pytest.approx(errors[-1], rel=1e-14)
    assert [segment.terminal_error for segment in result.segments] == pytest.approx(errors)


@by_name
def test_the_same_seed_gives_the_same_multistep_plan(method: Method) -> None:
    np.testing.assert_array_equal(multistep(method, 3).controls, multistep(method, 3).controls)


def test_segments_draw_different_candidates() -> None:
    first, second, third = (s.candidates.controls for s in multistep(Uniform()).segments)

    assert not np.array_equal(first, second)
    assert not np.array_equal(second, third)


def test_stuck_steps_costs_and_times_add_up_over_the_segments() -> None:
    result = multistep(Fixed(np.zeros((2, 32))), k=2)

    # The mass rests at 0, off every target, all the time.
    assert result.stuck_steps == 96
    assert result.cost == Cost(9, 66)
    assert result.timing.propose == pytest.approx(sum(s.timing.propose for s in result.segments))
    assert result.timing.rollout == pytest.approx(sum(s.timing.rollout for s in result.segments))


def test_every_segment_is_measured_against_its_own_target() -> None:
    method = Fixed(np.zeros((2, 32)))

    result = plan_multistep(
        np.array([0.4, 0.0]), TARGETS, SYSTEM, 32, method, 2, np.random.default_rng(0)
    )

    assert [segment.stuck_steps for segment in result.segments] == [0, 32, 32]
    assert [problem.target_state[0] for problem in method.problems] == [0.4, -0.4, 0.2]
    assert {problem.horizon for problem in method.problems} == {32}


def test_a_multistep_plan_to_one_target_is_the_plan_to_that_target() -> None:
    problem = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]), SYSTEM, 32)
    single = plan(problem, CEM(), 16, np.random.default_rng(4))

    result = plan_multistep(
        problem.initial_state,
        [problem.target_state],
        SYSTEM,
        32,
        CEM(),
        16,
        np.random.default_rng(4),
    )

    np.testing.assert_array_equal(result.controls, single.controls)
    np.testing.assert_array_equal(result.states, single.states)
    assert result.final_error == result.mean_end_error == single.terminal_error


def test_a_multistep_plan_without_targets_is_refused() -> None:
    with pytest.raises(ValueError, match="target"):
        plan_multistep(np.zeros(2), [], SYSTEM, 32, Uniform(), 4, np.random.default_rng(0))


@pytest.mark.parametrize(
    "state", [[0.0], [0.0, 0.0, 0.0], [[0.0, 0.0]], [math.nan, 0.0], [0.0, math.inf]]
)
def test_what_is_not_two_finite_numbers_is_no_state(state: list[float]) -> None:
    with pytest.raises(ValueError, match="two finite numbers"):
        as_state(state)
    with pytest.raises(ValueError, match="two finite numbers"):
        Problem(np.zeros(2), np.array(state))


def test_a_horizon_of_no_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="horizon"):
        Problem(np.zeros(2), np.zeros(2), SYSTEM, 0)


def rest_to_rest(position: float) -> Problem:
    return Problem(np.zeros(2), np.array([position, 0.0]))


@given(position=st.floats(-1.5, 1.5), seed=st.integers(0, 2**32 - 1))
def test_a_plan_stands_beside_its_floor(position: float, seed: int) -> None:
    made = plan(rest_to_rest(position), DatasetPrior(), 4, np.random.default_rng(seed))

    assert made.terminal_error >= made.reachability.floor - 1e-9
    assert made.gap == pytest.approx(made.terminal_error - made.reachability.floor, abs=1e-9)
    assert made.gap >= 0.0


@pytest.mark.parametrize("method", [DatasetPrior(), Uniform(), CEM(iterations=3)])
def test_refinement_serves_every_method_and_arrives(method: Method) -> None:
    for position in (-0.9, -0.2, 0.05, 0.6):
        problem = rest_to_rest(position)
        plain = plan(problem, method, 4, np.random.default_rng(0))
        refined = plan(problem, method, 4, np.random.default_rng(0), refinement=Refinement())

        assert refined.refinement is not None
        assert refined.refinement.error_before == pytest.approx(plain.terminal_error)
        assert refined.refinement.error_after == refined.terminal_error
        assert refined.terminal_error < 1e-9
        again = rollout(SYSTEM, problem.initial_state, refined.controls[None])[0]
        np.testing.assert_array_equal(again, refined.states)
        assert plain.refinement is None
        assert refined.cost.rollouts > plain.cost.rollouts


def test_an_unreachable_target_is_approached_to_its_floor() -> None:
    problem = rest_to_rest(1.4)
    made = plan(problem, DatasetPrior(), 16, np.random.default_rng(0), refinement=Refinement())

    assert not made.reachability.reachable
    assert made.reachability.floor > 0.05
    assert made.gap < 1e-6
    np.testing.assert_allclose(made.states[-1], made.reachability.nearest_state, atol=1e-5)


def test_an_objective_is_lowered_among_plans_that_arrive() -> None:
    def planned(objective: Objective) -> Plan:
        return plan(
            rest_to_rest(0.5),
            DatasetPrior(),
            16,
            np.random.default_rng(0),
            refinement=Refinement(),
            objective=objective,
        )

    usual, thrifty, smooth, quick = (planned(objective) for objective in get_args(Objective))

    for made in (usual, thrifty, smooth, quick):
        assert made.terminal_error < 2e-6
    assert thrifty.control_energy < 0.8 * usual.control_energy
    assert smooth.control_smoothness < 0.3 * usual.control_smoothness
    assert quick.stuck_steps <= usual.stuck_steps


def test_an_objective_never_outranks_the_terminal_error() -> None:
    lazy = plan(
        rest_to_rest(0.5),
        DatasetPrior(),
        64,
        np.random.default_rng(0),
        objective="control_energy",
    )

    assert lazy.terminal_error <= lazy.candidates.terminal_errors.min() + 1e-6


def test_a_multistep_plan_knows_the_floors_of_its_segments() -> None:
    targets = [np.array([1.4, 0.0]), np.array([0.2, 0.0])]
    made = plan_multistep(
        np.zeros(2),
        targets,
        SYSTEM,
        64,
        DatasetPrior(),
        16,
        np.random.default_rng(0),
        refinement=Refinement(),
    )

    floors = [segment.reachability.floor for segment in made.segments]
    assert floors[0] > 0.05
    assert made.mean_end_floor == pytest.approx(np.mean(floors))
    assert made.mean_end_error == pytest.approx(made.mean_end_floor, abs=1e-6)
