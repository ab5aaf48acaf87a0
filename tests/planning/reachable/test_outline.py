"""The outline of the reachable set, against states that controls really lead to."""

import numpy as np
import pytest
from matplotlib.path import Path

from app.planning.arrays import FloatArray
from app.planning.plant.machines import MACHINES
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.reachable.outline import outline
from app.planning.reachable.reachability import reachability
from app.planning.stop import Stop, Stopped

CASES = [
    (System(), 0.0, 64),
    (System(), 0.3, 64),
    (System(), -0.3, 24),
    (System(bias=1.0, control_limit=0.2), 0.0, 32),
    (System(), 0.0, 300),
    *((MACHINES[name].system, 0.0, 64) for name in ("emps", "cart_pole", "rack_and_pinion")),
]


def problem_of(system: System, velocity: float, horizon: int) -> Problem:
    return Problem(np.array([1.0, velocity]), np.array([9.0, 0.0]), system, horizon)


def bang_bang(problem: Problem, count: int) -> FloatArray:
    """Draw ends (count, 2) of controls that lie at a limit, or are nought, and switch twice."""
    rng = np.random.default_rng(0)
    plant = problem.system.plant
    levels = rng.choice([plant.lowest_control, 0.0, plant.highest_control], (count, 3))
    switches = np.sort(rng.integers(0, problem.horizon + 1, (count, 2)), axis=1)
    phases = (np.arange(problem.horizon)[None, :, None] >= switches[:, None, :]).sum(axis=2)
    controls = np.take_along_axis(levels, phases, axis=1)
    return rollout(problem.system, problem.initial_state, controls)[:, -1]


@pytest.mark.parametrize(("system", "velocity", "horizon"), CASES)
def test_every_state_that_controls_lead_to_lies_within(
    system: System, velocity: float, horizon: int
) -> None:
    problem = problem_of(system, velocity, horizon)
    found = outline(problem)
    scale = np.ptp(np.concatenate(found.polygons), axis=0)
    ends = bang_bang(problem, 2000)
    within = np.zeros(len(ends), dtype=bool)
    for polygon in found.polygons:
        for radius in (0.01, -0.01):  # by the way round, the one or the other is outward
            within |= Path(polygon / scale).contains_points(ends / scale, radius=radius)
    at_rest = np.abs(ends[:, 1]) < system.velocity_threshold
    for low, high in found.at_rest:
        slack = 0.01 * scale[0]
        within |= at_rest & (ends[:, 0] >= low - slack) & (ends[:, 0] <= high + slack)
    assert within.all()


@pytest.mark.parametrize(("system", "velocity", "horizon"), CASES)
def test_its_corners_can_be_reached(system: System, velocity: float, horizon: int) -> None:
    problem = problem_of(system, velocity, horizon)
    found = outline(problem)
    corners = np.concatenate(found.polygons)
    scale = np.linalg.norm(np.ptp(corners, axis=0))
    for corner in corners[:: max(1, len(corners) // 12)]:
        to_there = Problem(problem.initial_state, corner, system, horizon)
        assert reachability(to_there).floor < 0.01 * scale
    for position in found.at_rest.ravel():
        to_there = Problem(problem.initial_state, np.array([position, 0.0]), system, horizon)
        assert reachability(to_there).floor < 1e-6


def test_it_has_few_corners_whatever_the_horizon() -> None:
    found = outline(problem_of(System(), 0.0, 1024))
    assert sum(map(len, found.polygons)) < 1000


def test_it_ends_when_it_is_told_to() -> None:
    stop = Stop()
    stop.set(Stopped("enough"))
    with pytest.raises(Stopped, match="enough"):
        outline(problem_of(System(), 0.0, 64), stop)
