import numpy as np
import pytest

from app.planning.methods import DatasetPrior, Uniform
from app.planning.planner import plan
from app.planning.plant.system import System
from app.planning.prior import ControlPrior
from app.planning.problem import Cost, Problem
from app.planning.recipe import Recipe

PROBLEM = Problem(np.zeros(2), np.array([0.4, 0.0]), System(control_limit=1.5), horizon=50)


def test_the_candidates_are_draws_of_its_prior_for_the_plant_and_horizon() -> None:
    prior = ControlPrior(num_segments=4, filter_coefficient=0.0)

    proposal = DatasetPrior(prior=prior).propose(PROBLEM, 30, np.random.default_rng(2))

    np.testing.assert_array_equal(
        proposal.controls, prior.sample(30, 50, PROBLEM.system.plant, np.random.default_rng(2))
    )


def test_the_prior_of_the_training_data_is_the_default() -> None:
    assert DatasetPrior().prior == ControlPrior()


def test_its_kicks_get_further_than_uniform_shooting() -> None:
    task = Problem(np.zeros(2), np.array([0.5, 0.0]))

    def mean_error(method: DatasetPrior | Uniform) -> float:
        errors = [
            plan(task, Recipe(method, 128), np.random.default_rng(seed)).terminal_error
            for seed in range(20)
        ]
        return float(np.mean(errors))

    assert mean_error(DatasetPrior()) < 0.6 * mean_error(Uniform())


def test_it_costs_no_rollouts_of_its_own() -> None:
    assert DatasetPrior().cost(128) == Cost()


def test_an_impossible_prior_is_refused() -> None:
    with pytest.raises(ValueError, match="kick_minimum"):
        DatasetPrior(prior=ControlPrior(kick_minimum=2.0))
