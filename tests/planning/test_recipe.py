"""What a plan takes is known before it is made: exactly, or about where it is refined."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from app.planning.methods import CEM, ActionDiffusion, DatasetPrior, Learned, Uniform, WarmStarted
from app.planning.methods.base import Method, Named
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS
from app.planning.objectives import CONTROL_ENERGY, OBJECTIVES, Objective
from app.planning.planner import plan
from app.planning.problem import Cost, Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.uncertainty import Uncertainty
from tests.planning.fakes import Fixed, NoiseAsControls, every_method

PROBLEM = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]))


def test_a_plan_takes_a_rollout_of_each_candidate_on_top_of_the_proposal() -> None:
    assert Recipe(Fixed(np.zeros((4, 64))), 4).cost() == Cost(3, 44)
    assert Recipe(Uniform(), 16).cost() == Cost(0, 16)
    assert Recipe(CEM(iterations=5), 16).cost() == Cost(0, 96)


def test_the_cost_of_a_learned_method_is_known_once_its_model_has_settled_it() -> None:
    learned = ActionDiffusion(steps=50)
    warm_started = WarmStarted(CEM(iterations=5), learned)

    def cost(asked: Named) -> Cost:
        return Recipe(asked, 16).settled(PAPER_MODEL_SAMPLERS).cost()

    assert cost(learned) == Cost(100, 16, 2)
    assert cost(warm_started) == Cost(100, 96, 2)


def test_settling_a_method_and_giving_it_a_model_leave_the_rest_of_the_recipe_alone() -> None:
    ensemble = Ensemble.of([PROBLEM.system], PROBLEM.initial_state)
    chosen: dict[str, Any] = {
        "num_candidates": 3,
        "refinement": Refinement(repair=False),
        "objective": CONTROL_ENERGY,
        "reachability": True,
        "outline": True,
        "uncertainty": Uncertainty(ensemble, ensemble),
    }
    assert {"method", *chosen} == {field.name for field in fields(Recipe)}

    settled = Recipe(ActionDiffusion(), **chosen).settled(PAPER_MODEL_SAMPLERS)
    able = settled.able(NoiseAsControls())

    assert isinstance(able.method, Learned)
    for name, value in chosen.items():
        assert getattr(settled, name) is value
        assert getattr(able, name) is value


@every_method
def test_an_unrefined_plan_takes_what_its_recipe_says(method: Method) -> None:
    recipe = Recipe(method, 24, reachability=True)

    assert plan(PROBLEM, recipe, np.random.default_rng(0)).cost == recipe.cost()


@every_method
@pytest.mark.parametrize("num_candidates", [1, 24])
@pytest.mark.parametrize("objective", OBJECTIVES.values(), ids=OBJECTIVES)
@pytest.mark.parametrize(
    ("refinement", "positions"),
    [(Refinement(), (0.4, -0.9, 0.05)), (Refinement(repair=False), (0.4, -0.9, 3.0))],
    ids=["with repair", "by descent alone"],
)
def test_a_refined_plan_takes_no_more_than_is_estimated(
    method: Method,
    num_candidates: int,
    objective: Objective,
    refinement: Refinement,
    positions: tuple[float, ...],
) -> None:
    recipe = Recipe(method, num_candidates, refinement, objective)
    estimate, unrefined = recipe.cost(), recipe.unrefined.cost()

    for position in positions:
        problem = Problem(np.zeros(2), np.array([position, 0.0]))
        cost = plan(problem, recipe, np.random.default_rng(0)).cost
        assert unrefined.rollouts < cost.rollouts <= estimate.rollouts
        assert cost.network_evaluations == estimate.network_evaluations


@pytest.mark.parametrize("num_candidates", [1, 64])
@pytest.mark.parametrize("target", [(3.0, 0.0), (0.9, -0.5), (-0.2, 1.0)])
def test_where_nothing_arrives_it_takes_a_part_of_the_estimate(
    num_candidates: int, target: tuple[float, float]
) -> None:
    recipe = Recipe(DatasetPrior(), num_candidates, Refinement())

    made = plan(Problem(np.zeros(2), np.array(target)), recipe, np.random.default_rng(0))

    assert made.terminal_error > 0.1
    estimate = recipe.cost().rollouts
    assert 0.1 * estimate < made.cost.rollouts < 1.5 * estimate


def test_without_refinement_a_recipe_is_otherwise_the_same() -> None:
    recipe = Recipe(DatasetPrior(), 8, Refinement(), CONTROL_ENERGY, reachability=True)

    assert recipe.unrefined == Recipe(DatasetPrior(), 8, None, CONTROL_ENERGY, reachability=True)
