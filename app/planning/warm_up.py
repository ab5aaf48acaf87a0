"""Compiling every kernel before the first request needs it."""

import numpy as np

from app.planning.methods import CEM, DatasetPrior, Uniform
from app.planning.planner import plan
from app.planning.problem import Problem


def warm_up() -> None:
    """Make one tiny plan by each compiled method."""
    problem = Problem(np.zeros(2), np.array([0.2, 0.0]))
    for method in (Uniform(), DatasetPrior(), CEM(iterations=2)):
        plan(problem, method, num_candidates=2, rng=np.random.default_rng(0))
