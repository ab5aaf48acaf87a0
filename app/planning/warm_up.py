"""Compiling every kernel before the first request needs it."""

import numpy as np

from app.planning.methods import CEM, DatasetPrior, Uniform
from app.planning.objectives import OBJECTIVES
from app.planning.planner import plan
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement


def warm_up() -> None:
    """Make one tiny plan by each compiled method, and refine towards each objective."""
    problem = Problem(np.zeros(2), np.array([0.2, 0.0]))
    rng = np.random.default_rng(0)
    for method in (Uniform(), DatasetPrior(), CEM(iterations=2)):
        plan(problem, Recipe(method, 2, reachability=True), rng)
    for objective in OBJECTIVES.values():
        plan(problem, Recipe(DatasetPrior(), 2, Refinement(), objective), rng)
