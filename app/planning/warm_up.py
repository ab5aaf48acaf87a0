"""Tiny plans that between them need every kernel of planning: compiled before a request asks."""

import numpy as np

from app.planning.control import RecedingHorizon
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.identification.likelihood import Record, log_likelihoods
from app.planning.methods import CEM, DatasetPrior, Uniform
from app.planning.objectives import OBJECTIVES
from app.planning.planner import plan
from app.planning.problem import Problem
from app.planning.reachable.trace import trace
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.uncertainty import Uncertainty

_PROBLEM = Problem(np.zeros(2), np.array([0.2, 0.0]))


def make_refined_plans() -> None:
    """Refine towards each objective, and for several plants."""
    for objective in OBJECTIVES.values():
        recipe = Recipe(DatasetPrior(), 2, Refinement(), objective)
        plan(_PROBLEM, recipe, np.random.default_rng(0))
    ensemble = Ensemble.of([_PROBLEM.system] * 2, _PROBLEM.initial_state)
    uncertainty = Uncertainty(ensemble, ensemble, num_motions=2)
    recipe = Recipe(DatasetPrior(), 2, Refinement(), uncertainty=uncertainty)
    plan(_PROBLEM, recipe, np.random.default_rng(0))


def make_bounded_plan() -> None:
    """Plan with the reachable set and its outline, and out of it."""
    recipe = Recipe(DatasetPrior(), 2, reachability=True, outline=True)
    plan(_PROBLEM, recipe, np.random.default_rng(0))
    trace(_PROBLEM)


def weigh_log() -> None:
    """Say how likely a log of two steps is."""
    plants = Ensemble.of([_PROBLEM.system], _PROBLEM.initial_state)
    record = Record(np.zeros(2), np.zeros(3), np.zeros(3), 0.0, 1, 0.0, 1.0)
    log_likelihoods(plants.scenarios(_PROBLEM.target_state), np.ones((1, 3)), record, 1)


def make_plans() -> None:
    """Plan by each compiled method."""
    for method in (Uniform(), DatasetPrior(), CEM(iterations=2)):
        plan(_PROBLEM, Recipe(method, 2), np.random.default_rng(0))


def make_control_step() -> None:
    """Do a step of a closed loop: one kernel does steps and runs of all controllers."""
    control_step(RecedingHorizon(), _PROBLEM.system, Measurement(0.0, 0.0), Goal(0.2))


def warm_up() -> None:
    """Make all plans."""
    make_refined_plans()
    make_bounded_plan()
    make_plans()


def warm_up_loops() -> None:
    """Make what is not a plan."""
    weigh_log()
    make_control_step()
