import numpy as np

from app.planning.methods import Uniform
from app.planning.plant.system import System
from app.planning.problem import Cost, Problem

PROBLEM = Problem(np.zeros(2), np.array([0.4, 0.0]), System(control_limit=1.5), horizon=50)


def test_controls_are_uniform_within_the_limit() -> None:
    controls = Uniform().propose(PROBLEM, 2000, np.random.default_rng(0)).controls

    assert controls.shape == (2000, 50)
    np.testing.assert_allclose(
        np.quantile(controls, [0, 0.25, 0.5, 0.75, 1]), [-1.5, -0.75, 0, 0.75, 1.5], atol=0.02
    )


def test_controls_are_independent_of_one_another() -> None:
    controls = Uniform().propose(PROBLEM, 5000, np.random.default_rng(0)).controls

    assert np.max(np.abs(np.corrcoef(controls.T) - np.eye(50))) < 0.07


def test_it_costs_no_rollouts_of_its_own() -> None:
    assert Uniform().cost(128) == Cost()
