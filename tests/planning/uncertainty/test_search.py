"""The robust refinement: never worse in its risk, and near what is possible."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import DatasetPrior
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.refining.refinement import Refined, Refinement, refine
from app.planning.stop import Stop
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.risk import MEAN, Risk
from app.planning.uncertainty.search import refine_robustly
from app.planning.uncertainty.uncertainty import Uncertainty
from tests.planning.fakes import assert_stops
from tests.planning.plants import machines, systems

SHARES = Relative(0.1, 0.1, 0.1, control_gain=0.05)


def uncertain(problem: Problem, num_motions: int = 64, risk: Risk = MEAN) -> Uncertainty:
    def at(plants: FloatArray) -> Ensemble:
        return Ensemble.at(plants, problem.initial_state)

    system, rng = problem.system, np.random.default_rng(0)
    shares = Relative(0.1, 0.1, control_gain=0.05)
    drawn, apart = shares.draw(system, 16, rng), shares.draw(system, 256, rng)
    corners = at(shares.corners(system))
    return Uncertainty(at(drawn), at(apart), corners, risk, num_motions, shares)


def refined(problem: Problem, num_candidates: int = 4) -> Refined:
    plant, rng = problem.system.plant, np.random.default_rng(1)
    controls = DatasetPrior().prior.sample(num_candidates, problem.horizon, plant, rng)
    return refine(problem, controls, Refinement())


@given(
    systems() | machines(),
    st.tuples(*[st.floats(-1, 1)] * 4),
    st.integers(1, 30),
    st.sampled_from([MEAN, Risk("worst"), Risk("cvar", 0.5)]),
    st.integers(1, 3),
)
def test_no_candidate_is_lost_to_a_worse_one(
    system: System, states: tuple[float, ...], horizon: int, risk: Risk, num_candidates: int
) -> None:
    problem = Problem(np.array(states[:2]), np.array(states[2:]), system, horizon)
    uncertainty = uncertain(problem, 16, risk)
    before = refined(problem, num_candidates)
    after = refine_robustly(problem, before, uncertainty, np.random.default_rng(2))

    risks = uncertainty.risks(before.controls, problem.target_state)
    made = uncertainty.risks(after.controls, problem.target_state)
    changed = np.any(after.controls != before.controls, axis=1)
    assert np.count_nonzero(changed) <= 1
    np.testing.assert_array_equal(made[~changed], risks[~changed])
    assert np.all(made <= risks)
    assert np.all(after.replaced >= changed)
    plant = system.plant
    assert np.all(
        (plant.lowest_control <= after.controls) & (after.controls <= plant.highest_control)
    )
    assert after.rollouts > before.rollouts


@pytest.mark.parametrize("displacement", [0.1, 0.2])
def test_with_time_it_comes_near_the_least_error_of_any_plan(displacement: float) -> None:
    problem = Problem(np.zeros(2), np.array([displacement, 0.0]), horizon=128)
    uncertainty = uncertain(problem, 2048)
    before = refined(problem)
    after = refine_robustly(problem, before, uncertainty, np.random.default_rng(2))

    best = after.controls[np.argmin(uncertainty.risks(after.controls, problem.target_state))]
    errors = uncertainty.judges.errors(best[np.newaxis], problem.target_state)
    bound = SHARES.least_rms_error(problem)
    assert bound is not None
    rms = float(np.sqrt(np.mean(errors**2)))
    assert 0.85 * bound < rms < 1.6 * bound
    nominal = uncertainty.judges.errors(before.controls, problem.target_state)
    assert np.sqrt(np.mean(nominal**2, axis=1)).min() > 3 * rms


def test_the_estimate_of_its_cost_is_of_the_right_size() -> None:
    problem = Problem(np.zeros(2), np.array([0.3, 0.0]))
    uncertainty = uncertain(problem, 1024)
    before = refined(problem)
    after = refine_robustly(problem, before, uncertainty, np.random.default_rng(2))

    estimate = uncertainty.cost(4, refined=True).rollouts
    assert 0.5 < (after.rollouts - before.rollouts) / estimate < 1.5


def test_it_stops_when_it_is_told() -> None:
    problem = Problem(np.zeros(2), np.array([0.3, 0.0]), horizon=1024)
    uncertainty, before = uncertain(problem, 8192), refined(Problem(np.zeros(2), np.ones(2)), 1)
    controls = np.zeros((1, 1024))
    before = Refined(controls, before.errors, before.errors, before.replaced, 0, None)
    begun: list[bool] = []

    def work(stop: Stop) -> None:
        begun.append(True)
        refine_robustly(problem, before, uncertainty, np.random.default_rng(2), stop)

    assert_stops(work, lambda: bool(begun))
