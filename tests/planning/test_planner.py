"""How a plan comes about: proposed, clipped, refined, rolled out, ranked and measured."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning import planner
from app.planning.arrays import FloatArray
from app.planning.methods import CEM, DatasetPrior, Uniform
from app.planning.methods.base import Method
from app.planning.metrics import control_energy, control_smoothness, stuck_steps, terminal_error
from app.planning.objectives import CONTROL_ENERGY, OBJECTIVES, TOLERANCE, Objective
from app.planning.plan import MultistepPlan, Plan
from app.planning.planner import plan, plan_multistep
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, ControlLimits, System
from app.planning.problem import Cost, PlanningError, Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.risk import MEAN, Risk
from app.planning.uncertainty.uncertainty import Uncertainty
from tests.planning.fakes import EVERY_METHOD, LEARNED, Fixed, every_method

SYSTEM = System()
PROBLEM = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]))
TARGETS = [np.array([0.4, 0.0]), np.array([-0.4, 0.0]), np.array([0.2, 0.0])]


def planned(recipe: Recipe[Method], problem: Problem = PROBLEM, seed: int = 0) -> Plan:
    return plan(problem, recipe, np.random.default_rng(seed))


def multistep(
    recipe: Recipe[Method],
    seed: int = 0,
    targets: Sequence[FloatArray] = TARGETS,
    start: tuple[float, float] = (0.0, 0.0),
    horizon: int = 32,
) -> MultistepPlan:
    # The problem's own target is nobody's.
    problem = Problem(np.array(start), np.array([9.0, 9.0]), SYSTEM, horizon)
    return plan_multistep(problem, targets, recipe, np.random.default_rng(seed))


@every_method
def test_the_plan_is_the_rollout_of_its_own_controls(method: Method) -> None:
    result = planned(Recipe(method, 24))

    states = rollout(SYSTEM, PROBLEM.initial_state, result.controls[None])[0]
    np.testing.assert_array_equal(result.states, states)
    error = math.dist(states[-1], PROBLEM.target_state)
    assert result.terminal_error == pytest.approx(error, rel=1e-14)
    assert result.control_energy == control_energy(result.controls)
    assert result.control_smoothness == control_smoothness(result.controls)
    assert result.stuck_steps == stuck_steps(states, result.controls, 0.4, SYSTEM)


@every_method
def test_the_candidates_are_the_rollouts_of_their_own_controls(method: Method) -> None:
    candidates = planned(Recipe(method, 24)).candidates

    assert candidates.controls.shape == (24, 64)
    np.testing.assert_array_equal(
        candidates.states, rollout(SYSTEM, PROBLEM.initial_state, candidates.controls)
    )
    np.testing.assert_allclose(
        candidates.terminal_errors,
        [math.dist(state, PROBLEM.target_state) for state in candidates.states[:, -1]],
        rtol=1e-14,
    )


@every_method
def test_the_plan_is_the_best_of_its_candidates(method: Method) -> None:
    result = planned(Recipe(method, 24))

    best = int(np.argmin(result.candidates.terminal_errors))
    assert result.terminal_error == result.candidates.terminal_errors[best]
    np.testing.assert_array_equal(result.controls, result.candidates.controls[best])
    np.testing.assert_array_equal(result.states, result.candidates.states[best])


def test_proposals_beyond_the_limit_are_clipped_before_they_are_rolled_out() -> None:
    proposed = np.array([[5.0] * 64, [-5.0] * 64, [0.3] * 64])

    result = planned(Recipe(Fixed(proposed), 3))

    np.testing.assert_array_equal(
        result.candidates.controls, np.array([[0.9] * 64, [-0.9] * 64, [0.3] * 64])
    )
    np.testing.assert_array_equal(
        result.candidates.states,
        rollout(SYSTEM, PROBLEM.initial_state, result.candidates.controls),
    )


def test_the_candidates_keep_the_order_of_the_proposal() -> None:
    proposed = np.linspace(-0.9, 0.9, 5)[:, None].repeat(64, axis=1)

    np.testing.assert_array_equal(planned(Recipe(Fixed(proposed), 5)).candidates.controls, proposed)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_proposal_that_is_not_finite_is_an_error_that_names_the_method(value: float) -> None:
    proposed = np.zeros((4, 64))
    proposed[2, 10] = value

    with pytest.raises(PlanningError, match="fixed"):
        planned(Recipe(Fixed(proposed), 4))


def test_the_wait_of_the_proposal_is_reported_as_queueing() -> None:
    timing = planned(Recipe(LEARNED, 24)).timing

    assert timing.queue == 2.5
    assert timing.total == pytest.approx(
        timing.queue + timing.propose + timing.refine + timing.rollout
    )


@every_method
def test_each_segment_starts_exactly_where_the_one_before_ended(method: Method) -> None:
    segments = multistep(Recipe(method, 24)).segments

    assert len(segments) == 3
    np.testing.assert_array_equal(segments[0].states[0], [0.0, 0.0])
    for before, after in pairwise(segments):
        np.testing.assert_array_equal(before.states[-1], after.states[0])


@every_method
def test_the_composed_plan_is_one_rollout_of_the_composed_controls(method: Method) -> None:
    result = multistep(Recipe(method, 24))

    assert result.controls.shape == (96,)
    np.testing.assert_array_equal(
        result.controls, np.concatenate([segment.controls for segment in result.segments])
    )
    np.testing.assert_array_equal(
        result.states, rollout(SYSTEM, np.zeros(2), result.controls[None])[0]
    )


@every_method
def test_multistep_errors_are_those_at_the_ends_of_the_segments(method: Method) -> None:
    result = multistep(Recipe(method, 24))

    ends = result.states[[32, 64, 96]]
    errors = [math.dist(end, target) for end, target in zip(ends, TARGETS, strict=True)]
    assert result.mean_end_error == pytest.approx(np.mean(errors), rel=1e-14)
    assert result.final_error == pytest.approx(errors[-1], rel=1e-14)
    assert [segment.terminal_error for segment in result.segments] == pytest.approx(errors)


@every_method
def test_the_same_seed_gives_the_same_multistep_plan(method: Method) -> None:
    np.testing.assert_array_equal(
        multistep(Recipe(method, 24), 3).controls, multistep(Recipe(method, 24), 3).controls
    )


def test_segments_draw_different_candidates() -> None:
    first, second, third = (
        s.candidates.controls for s in multistep(Recipe(Uniform(), 24)).segments
    )

    assert not np.array_equal(first, second)
    assert not np.array_equal(second, third)


def test_stuck_steps_costs_and_times_add_up_over_the_segments() -> None:
    result = multistep(Recipe(Fixed(np.zeros((2, 32))), 2))

    # The mass rests at 0, off every target, all the time.
    assert result.stuck_steps == 96
    assert result.cost == Cost(9, 66)
    assert result.timing.propose == pytest.approx(sum(s.timing.propose for s in result.segments))
    assert result.timing.rollout == pytest.approx(sum(s.timing.rollout for s in result.segments))


def test_every_segment_is_measured_against_its_own_target() -> None:
    method = Fixed(np.zeros((2, 32)))

    result = multistep(Recipe(method, 2), start=(0.4, 0.0))

    assert [segment.stuck_steps for segment in result.segments] == [0, 32, 32]
    assert [problem.target_state[0] for problem in method.problems] == [0.4, -0.4, 0.2]
    assert {problem.horizon for problem in method.problems} == {32}


def test_a_multistep_plan_to_one_target_is_the_plan_to_that_target() -> None:
    problem = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]), SYSTEM, 32)
    single = planned(Recipe(CEM(), 16), problem, seed=4)

    result = multistep(Recipe(CEM(), 16), 4, [problem.target_state], (0.1, -0.2))

    np.testing.assert_array_equal(result.controls, single.controls)
    np.testing.assert_array_equal(result.states, single.states)
    assert result.final_error == result.mean_end_error == single.terminal_error


def test_a_multistep_plan_without_targets_is_refused() -> None:
    with pytest.raises(ValueError, match="target"):
        multistep(Recipe(Uniform(), 4), targets=[])


def rest_to_rest(position: float) -> Problem:
    return Problem(np.zeros(2), np.array([position, 0.0]))


@given(position=st.floats(-1.5, 1.5), seed=st.integers(0, 2**32 - 1))
def test_a_plan_stands_beside_its_floor(position: float, seed: int) -> None:
    result = planned(Recipe(DatasetPrior(), 4, reachability=True), rest_to_rest(position), seed)

    assert result.reachability is not None
    assert result.gap is not None
    assert result.terminal_error >= result.reachability.floor - 1e-9
    assert result.gap == pytest.approx(result.terminal_error - result.reachability.floor, abs=1e-9)
    assert result.gap >= 0.0


def test_the_floor_is_computed_only_where_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for, or where a refined plan does not arrive otherwise."""

    def refuse(*_: object) -> None:
        raise AssertionError("nobody asked for the floor")

    monkeypatch.setattr(planner, "reachability", refuse)

    for refinement in (None, Refinement()):
        single = planned(Recipe(DatasetPrior(), 4, refinement))
        assert single.reachability is None
        assert single.gap is None
        composed = multistep(
            Recipe(DatasetPrior(), 4, refinement), targets=[np.array([0.2, 0.0]), np.zeros(2)]
        )
        assert composed.mean_end_floor is None
        assert all(segment.reachability is None for segment in composed.segments)


@pytest.mark.parametrize("refinement", [None, Refinement()])
def test_asking_for_the_floor_changes_nothing_else(refinement: Refinement | None) -> None:
    without, beside = (
        planned(Recipe(DatasetPrior(), 4, refinement, reachability=reachability))
        for reachability in (False, True)
    )

    np.testing.assert_array_equal(without.candidates.controls, beside.candidates.controls)
    np.testing.assert_array_equal(without.states, beside.states)
    assert without.cost == beside.cost


@every_method
def test_refinement_serves_every_method_and_arrives(method: Method) -> None:
    for position in (-0.9, -0.2, 0.05, 0.6):
        problem = rest_to_rest(position)
        plain = planned(Recipe(method, 4), problem)
        refined = planned(Recipe(method, 4, Refinement()), problem)

        assert refined.refinement is not None
        assert refined.refinement.error_before == pytest.approx(plain.terminal_error)
        assert refined.refinement.error_after == refined.terminal_error
        assert refined.terminal_error < 1e-9
        again = rollout(SYSTEM, problem.initial_state, refined.controls[None])[0]
        np.testing.assert_array_equal(again, refined.states)
        assert plain.refinement is None
        assert refined.cost.rollouts > plain.cost.rollouts


def test_an_unreachable_target_is_approached_to_its_floor() -> None:
    recipe = Recipe(DatasetPrior(), 16, Refinement(), reachability=True)
    result = planned(recipe, rest_to_rest(1.4))

    assert result.reachability is not None
    assert result.gap is not None
    assert not result.reachability.reachable
    assert result.reachability.floor > 0.05
    assert result.gap < 1e-6
    np.testing.assert_allclose(result.states[-1], result.reachability.nearest_state, atol=1e-5)


def test_an_objective_is_lowered_among_plans_that_arrive() -> None:
    def planned_for(objective: Objective) -> Plan:
        return planned(Recipe(DatasetPrior(), 16, Refinement(), objective), rest_to_rest(0.5))

    plans = {name: planned_for(objective) for name, objective in OBJECTIVES.items()}
    usual = plans["terminal_error"]

    for result in plans.values():
        assert result.terminal_error < 2e-6
    assert plans["control_energy"].control_energy < 0.8 * usual.control_energy
    assert plans["control_smoothness"].control_smoothness < 0.3 * usual.control_smoothness
    assert plans["stuck_steps"].stuck_steps <= usual.stuck_steps


def test_an_objective_never_outranks_the_terminal_error() -> None:
    lazy = planned(Recipe(DatasetPrior(), 64, objective=CONTROL_ENERGY), rest_to_rest(0.5))

    assert lazy.terminal_error <= lazy.candidates.terminal_errors.min() + 1e-6


def test_a_multistep_plan_knows_the_floors_of_its_segments() -> None:
    result = multistep(
        Recipe(DatasetPrior(), 16, Refinement(), reachability=True),
        targets=[np.array([1.4, 0.0]), np.array([0.2, 0.0])],
        horizon=64,
    )

    floors = [segment.reachability.floor for segment in result.segments if segment.reachability]
    assert len(floors) == 2
    assert floors[0] > 0.05
    assert result.mean_end_floor == pytest.approx(np.mean(floors))
    assert result.mean_end_error == pytest.approx(result.mean_end_floor, abs=1e-6)


@pytest.mark.parametrize("objective", OBJECTIVES.values(), ids=OBJECTIVES)
def test_with_no_objective_refinement_ends_further_off_than_it_began(objective: Objective) -> None:
    # Full control is the best there is; another one lacks less than a millionth, for less energy.
    controls = np.full((2, 20), 0.9)
    controls[1, 5] -= 1e-6
    recipe = Recipe(Fixed(controls), 2, Refinement(num_refined=1), objective)
    problem = Problem(np.zeros(2), np.array([5.0, 0.0]), horizon=20)
    errors = terminal_error(rollout(System(), np.zeros(2), controls)[:, -1], problem.target_state)
    assert 0 < errors[1] - errors[0] < TOLERANCE

    effect = plan(problem, recipe, np.random.default_rng(0)).refinement

    assert effect is not None
    assert effect.error_after <= effect.error_before + 1e-12


@pytest.mark.parametrize(
    "method", [each for each in EVERY_METHOD if each is not LEARNED], ids=lambda method: method.name
)
@pytest.mark.parametrize("objective", OBJECTIVES.values(), ids=OBJECTIVES)
@pytest.mark.parametrize("refinement", [None, Refinement()], ids=["unrefined", "refined"])
def test_other_units_of_control_give_the_same_motion(
    method: Method, objective: Objective, refinement: Refinement | None
) -> None:
    system = System(
        ByDirection(0.7, 0.5), ByDirection(0.6, 0.4), bias=0.1, control_limit=ControlLimits(-0.8, 1)
    )
    # A power of two, with which no digit is lost.
    volts = replace(system, control_gain=1 / 16, control_limit=ControlLimits(-16 * 0.8, 16))
    recipe = Recipe(method, 8, refinement, objective)
    for target in ((0.3, 0.0), (-0.2, 0.1)):
        usual, other = (
            planned(recipe, Problem(np.array([0.1, -0.1]), np.array(target), which))
            for which in (system, volts)
        )
        np.testing.assert_array_equal(other.controls, 16 * usual.controls)
        np.testing.assert_array_equal(other.states, usual.states)


@given(
    factor=st.sampled_from([1e-3, 0.1, 3.0, 1e3]),
    position=st.floats(-0.8, 0.8),
    velocity=st.just(0.0) | st.floats(-0.3, 0.3),
)
def test_other_units_of_length_give_the_same_floor_and_a_plan_that_arrives(
    factor: float, position: float, velocity: float
) -> None:
    recipe = Recipe(DatasetPrior(), 8, Refinement(), reachability=True)
    scaled_system = System(
        0.7 * factor,
        0.6 * factor,
        control_limit=0.9 * factor,
        velocity_threshold=1e-3 * factor,
    )
    start, target = np.array([0.1, -0.1]), np.array([position, velocity])

    usual = planned(recipe, Problem(start, target))
    scaled = planned(recipe, Problem(factor * start, factor * target, scaled_system))

    assert usual.reachability
    assert scaled.reachability
    assert scaled.reachability.floor == pytest.approx(
        factor * usual.reachability.floor, abs=1e-8 * max(1.0, factor)
    )
    assert scaled.gap == pytest.approx(0.0, abs=1e-6 * max(1.0, factor))


SHARES = Relative(static_friction=0.1, coulomb_friction=0.1, control_gain=0.05)


def uncertain(problem: Problem = PROBLEM, risk: Risk = MEAN) -> Uncertainty:
    drawn = SHARES.draw(problem.system, 16, np.random.default_rng(5))
    ensemble = Ensemble.at(drawn, problem.initial_state)
    return Uncertainty(ensemble, ensemble, risk=risk, num_motions=64, relative=SHARES)


@every_method
@pytest.mark.parametrize("refinement", [None, Refinement()], ids=["proposed", "refined"])
@pytest.mark.parametrize("risk", [MEAN, Risk("worst"), Risk("cvar", 0.8)], ids=lambda r: r.name)
def test_the_risk_over_uncertain_plants_ranks_and_is_never_above_that_of_the_nominal_plan(
    method: Method, refinement: Refinement | None, risk: Risk
) -> None:
    recipe = Recipe(method, 6, refinement)
    uncertainty = uncertain(risk=risk)
    nominal = planned(recipe)
    robust = planned(replace(recipe, uncertainty=uncertainty))

    target = PROBLEM.target_state
    risks = uncertainty.risks(robust.candidates.controls, target)
    assert robust.robustness is not None
    assert robust.robustness.value == pytest.approx(risks.min(), abs=1e-12)
    assert risks.min() <= uncertainty.risks(nominal.controls[np.newaxis], target)[0]
    assert robust.robustness.nominal_error == robust.terminal_error
    assert robust.cost.rollouts > nominal.cost.rollouts
    assert nominal.robustness is None


def test_of_plans_of_the_same_risk_the_objective_decides() -> None:
    same = np.repeat([[0.0], [0.5], [-0.1]], 64, axis=1)  # nothing moves on any plant
    problem = Problem(np.zeros(2), np.array([0.4, 0.0]))
    recipe = Recipe(Fixed(same), 3, objective=CONTROL_ENERGY, uncertainty=uncertain(problem))

    assert np.all(planned(recipe, problem).controls == 0.0)


def test_from_target_to_target_each_plant_goes_on_from_where_it_is() -> None:
    problem = Problem(np.zeros(2), np.array([9.0, 9.0]), SYSTEM, 32)
    uncertainty = uncertain(problem)
    recipe = Recipe(DatasetPrior(), 4, Refinement(), uncertainty=uncertainty)
    plans = plan_multistep(problem, TARGETS[:2], recipe, np.random.default_rng(0))

    for count, segment in enumerate(plans.segments, 1):
        controls = plans.controls[np.newaxis, : 32 * count]
        errors = uncertainty.ensemble.errors(controls, TARGETS[count - 1])[0]
        assert segment.robustness is not None
        assert segment.robustness.mean_error == pytest.approx(errors.mean())
        # Only the first one starts where every plant is.
        assert (segment.robustness.first_order_bound is None) == (count > 1)
