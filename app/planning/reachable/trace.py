"""A plan out of the reachable set: from its state nearest to the target back to the start.

Every state of the set at a step has predecessors in the set one step earlier. A chain of them is a
plan, and ends on the floor by construction.
"""

import math
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import (
    breaking_away,
    can_rest,
    control_towards,
    holding_control,
    is_symmetric,
    sliding,
    take_step,
    velocity_that_keeps,
)
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from app.planning.problem import Problem
from app.planning.reachable.curves import STRAIGHT
from app.planning.reachable.polylines import Piece, deepest, mirrored
from app.planning.reachable.reachability import (
    Found,
    Reachability,
    Sets,
    described,
    displaced,
    propagate,
    tolerance_of,
)
from app.planning.reachable.regimes import DIRECTIONS, ROUNDING
from app.planning.stop import NEVER, Flag, Stop


def trace(problem: Problem, stop: Stop = NEVER) -> tuple[Reachability, FloatArray]:
    """Return what can be reached, and controls (H,) that end in the nearest state of it.

    Backward in time a step's next velocity w gives its predecessor's position at once, since
    p' = p + dt*w; of the velocities v that the set holds there, and from which some control leads
    to w, the one deepest inside the set is taken, so that rounding does not lead out of it.
    Forward in time the controls follow from the velocities.

    Where that state is reached in fewer than H steps, the rest is waited: at the start if that is
    at rest, at the target otherwise.

    Args:
        problem: start, target, plant and horizon H.
        stop: ends it early.

    Raises:
        Stopped: `stop` said so.
    """
    within = tolerance_of(problem)
    first, found, moving = _reach_and_trace(displaced(problem), problem.horizon, within, stop.flag)
    stop.check()
    controls = np.full(problem.horizon, holding_control(problem.task.plant))
    begin = problem.horizon - found.steps if problem.task.velocity == 0.0 else 0
    controls[begin : begin + found.steps] = moving
    return described(problem, within, first, found), controls


SLACKS = (0.0, ROUNDING, 1e-6)
"""By which windows of velocities are wider than they are, relative."""
OUTSIDE = 1e-9
"""This far outside of the set, m, a state counts as in it."""


class _Way(NamedTuple):
    """A velocity from which a step can come."""

    depth: float
    """How far inside the set it lies, m; negative outside."""
    velocity: float


@compiled
def _reach_and_trace(
    task: Task, horizon: int, tolerance: float, stopped: Flag
) -> tuple[int, Found, FloatArray]:
    """Return what `propagate` does, and the controls that lead to the state that it found."""
    plant = task.plant
    symmetric = task.velocity == 0.0 and is_symmetric(plant)
    first, found, sets = propagate(task, horizon, tolerance, True, stopped)
    velocities, controls = np.empty(found.steps + 1), np.zeros(found.steps)
    position, velocities[found.steps] = found.state.y, found.state.v
    for n in range(found.steps - 1, -1, -1):
        if stopped[0]:
            return first, found, controls
        position -= plant.time_step * velocities[n + 1]
        velocities[n] = _predecessor(sets, n, position, velocities[n + 1], symmetric, plant)
    velocity = task.velocity
    for n in range(found.steps):
        controls[n] = control_towards(velocities[n + 1], velocity, plant)
        velocity = take_step(velocity, controls[n], plant).next_velocity
    return first, found, controls


@compiled
def _predecessor(
    sets: Sets, n: int, position: float, after: float, symmetric: bool, plant: Plant
) -> float:
    """Return a velocity at step `n` and `position` from which a step leads to velocity `after`.

    A velocity may lie just beyond a piece's end, a jump of its edge or what a control can do, by
    rounding alone: where there is none otherwise, windows are a little wider.
    """
    best = _Way(-math.inf, 0.0)
    outside = OUTSIDE if plant.stribeck_velocity == 0.0 else STRAIGHT
    for slack in SLACKS:
        best = _from_rest(sets.rests[n], position, after, plant)
        for i in range(sets.begins[n], sets.begins[n + 1]):
            piece = Piece(sets.uppers[i], sets.lowers[i])
            best = _from_piece(best, piece, position, after, slack, plant)
            if symmetric:
                best = _from_piece(best, mirrored(piece), position, after, slack, plant)
        if best.depth > -outside:
            break
    return best.velocity


@compiled
def _from_rest(rests: FloatArray, position: float, after: float, plant: Plant) -> _Way:
    """Return the way from a state at rest, v = 0."""
    excess = abs(after) if can_rest(plant) else math.inf  # of what no control does
    for direction in DIRECTIONS:
        regime = breaking_away(direction, plant)
        if regime.low <= regime.high:
            excess = min(excess, max(regime.low - after, after - regime.high, 0.0))
    depth = -math.inf
    for rest in rests:
        depth = max(depth, min(position - rest[0], rest[1] - position))
    return _Way(depth if excess <= 0.0 else min(depth, -excess), 0.0)


@compiled
def _from_piece(
    best: _Way, piece: Piece, position: float, after: float, slack: float, plant: Plant
) -> _Way:
    """Return the better of `best` and the ways from a piece, through each regime."""
    # Rounding must not carry a velocity across the edge between rest and motion.
    slowest = (1.0 + ROUNDING) * plant.velocity_threshold
    fastest_rest = (1.0 - ROUNDING) * plant.velocity_threshold
    band = Window(-fastest_rest, fastest_rest)
    anything = Window(-math.inf, math.inf)
    if after == 0.0 and can_rest(plant):
        best = _better(best, piece, position, anything, band, slack)
    for direction in DIRECTIONS:
        regime = breaking_away(direction, plant)
        if regime.low <= regime.high:
            window = Window(after - regime.high, after - regime.low)
            best = _better(best, piece, position, window, band, slack)
        if after * direction < 0.0:
            continue
        regime = sliding(direction, plant)
        low = velocity_that_keeps(after - regime.high, direction, plant)
        high = velocity_that_keeps(after - regime.low, direction, plant)
        if direction > 0.0:
            # Friction stops the mass, whatever the control makes of it.
            window = Window(-math.inf if after == 0.0 else low, high)
            best = _better(best, piece, position, window, Window(slowest, math.inf), slack)
        else:
            window = Window(low, math.inf if after == 0.0 else high)
            best = _better(best, piece, position, window, Window(-math.inf, -slowest), slack)
    return best


class Window(NamedTuple):
    """Velocities from `low` to `high`, m/s."""

    low: float
    high: float


@compiled
def _better(
    best: _Way, piece: Piece, position: float, window: Window, regime: Window, slack: float
) -> _Way:
    """Return the better of `best` and the deepest way from a piece, in a window and a regime."""
    slack = slack * (1.0 + abs(piece.upper[0, 0]) + abs(piece.upper[-1, 0]))
    low, high = max(window.low - slack, regime.low), min(window.high + slack, regime.high)
    if low > piece.upper[-1, 0]:
        low -= slack
    if high < piece.upper[0, 0]:
        high += slack
    if low > high:
        return best
    depth, velocity = deepest(piece, position, low, high)
    return _Way(depth, velocity) if depth > best.depth else best
