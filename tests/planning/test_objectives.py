"""Which candidate is best, among those that arrive equally well."""

import math

import numpy as np
import pytest

from app.planning.metrics import terminal_error
from app.planning.objectives import CONTROL_ENERGY, OBJECTIVES, TOLERANCE, best_candidate
from app.planning.plant.rollout import rollout
from app.planning.problem import Problem


def test_the_objective_chooses_among_those_that_arrive() -> None:
    problem = Problem(np.zeros(2), np.zeros(2))
    controls = np.zeros((4, 64))
    controls[0, 0] = 0.9
    controls[1, ::2] = 0.3
    controls[2] = 0.4
    states = rollout(problem.system, problem.initial_state, controls)
    errors = terminal_error(states[:, -1], problem.target_state)
    assert errors[0] > TOLERANCE
    chosen = {
        name: best_candidate(problem, controls[:3], states[:3], errors[:3], objective)
        for name, objective in OBJECTIVES.items()
    }
    assert chosen == {
        "terminal_error": 1,
        "control_energy": 1,
        "control_smoothness": 2,
        "stuck_steps": 1,
    }


def test_of_equal_measures_the_lesser_terminal_error_decides() -> None:
    problem = Problem(np.zeros(2), np.array([1.0, 0.0]))
    controls = np.zeros((3, 4))
    states = np.zeros((3, 5, 2))
    errors = np.array([0.5, 0.5 - 0.4 * TOLERANCE, 0.5 - 0.2 * TOLERANCE])

    for objective in OBJECTIVES.values():
        assert best_candidate(problem, controls, states, errors, objective) == 1


@pytest.mark.parametrize(
    ("error_limit", "best"), [(math.inf, 0), (0.5 + 0.4 * TOLERANCE, 1), (0.0, 2)]
)
def test_a_lesser_measure_does_not_excuse_an_error_beyond_the_limit(
    error_limit: float, best: int
) -> None:
    problem = Problem(np.zeros(2), np.array([1.0, 0.0]))
    controls = np.array([[0.0], [0.1], [0.2]])
    states = np.zeros((3, 2, 2))
    errors = 0.5 + TOLERANCE * np.array([0.5, 0.3, 0.0])

    assert best_candidate(problem, controls, states, errors, CONTROL_ENERGY, error_limit) == best


def test_rounding_does_not_decide_between_candidates_that_tie() -> None:
    problem = Problem(np.zeros(2), np.zeros(2), horizon=2)
    controls = np.array([[0.3, 0.4], [0.4, 0.3], [0.1, 0.6]])
    controls[0] *= 1 + 1e-15
    states = np.zeros((3, 3, 2))
    errors = np.array([2e-13, 1e-13, 0.0])

    assert best_candidate(problem, controls, states, errors, CONTROL_ENERGY) == 0
    assert best_candidate(problem, controls[::-1], states, errors[::-1], CONTROL_ENERGY) == 1
    far = np.array([2e-8, 1e-13, 0.0])
    assert best_candidate(problem, controls, states, far, CONTROL_ENERGY) == 1
