"""The reachable set as polygons, to be looked at. Whether a target lies in it: reachability.py."""

import math
from dataclasses import dataclass

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import can_rest, is_symmetric
from app.planning.plant.task import Task
from app.planning.problem import Problem
from app.planning.reachable.polylines import (
    TOUCHING,
    Piece,
    Pieces,
    add,
    join,
    mirrored,
    no_pieces,
    union_of_intervals,
)
from app.planning.reachable.reachability import displaced, propagate
from app.planning.stop import NEVER, Flag, Stop

_MOST_CORNERS = 128
"""Of an edge of the set: its steps, one a time step, are finer than a picture where it has more."""
_MOST_SETS = 128
"""So many sets, one after the other, tell what all of a long horizon are together."""
_NEVER_ARRIVES = -1.0
"""A tolerance that no distance is within: the set is propagated over the whole horizon."""


@dataclass(frozen=True, slots=True)
class Outline:
    """Where a plant can be after the horizon, whatever the controls."""

    polygons: tuple[FloatArray, ...]
    """Their union is the set; (N, 2) each, corners [p, v] in m and m/s, in order."""
    at_rest: FloatArray
    """(R, 2): the intervals of positions (m) at which it can be at rest, disjoint and in order."""


def outline(problem: Problem, stop: Stop = NEVER) -> Outline:
    """Return the reachable set of `reachability`, to within a hundredth of its width.

    Raises:
        Stopped: `stop` said so.
    """
    pieces, rests = _union(displaced(problem), problem.horizon, stop.flag)
    stop.check()
    start = problem.initial_state[0]
    polygons = []
    for upper, lower in zip(pieces.uppers, pieces.lowers, strict=True):
        corners = np.concatenate([_read_off(upper), (_read_off(lower) * (1.0, -1.0))[::-1]])
        polygons.append(np.column_stack([start + corners[:, 1], corners[:, 0]]))
    return Outline(tuple(polygons), start + rests)


def _read_off(line: FloatArray) -> FloatArray:
    """Return a polyline (N, 2) of at most so many corners."""
    if len(line) <= _MOST_CORNERS:
        return line
    velocities = np.linspace(line[0, 0], line[-1, 0], _MOST_CORNERS)
    return np.column_stack([velocities, np.interp(velocities, line[:, 0], line[:, 1])])


@compiled
def _union(task: Task, horizon: int, stopped: Flag) -> tuple[Pieces, FloatArray]:
    """Return the states after `horizon` steps, from position zero, and the positions at rest.

    After a start at rest that can wait, they are those of all steps (see `reachability`); of a long
    horizon, those of `_MOST_SETS` of them.
    """
    _, _, sets = propagate(task, horizon, _NEVER_ARRIVES, True, stopped)
    departs = task.velocity == 0.0 and can_rest(task.plant)
    last = len(sets.rests) - 1
    stride = max(1, math.ceil(horizon / _MOST_SETS))
    first = last % stride if departs else last
    union = no_pieces()
    rests = [(rest[0], rest[1]) for rest in sets.rests[0][: 1 if departs else 0]]
    for step in range(first, last + 1, stride):
        for i in range(sets.begins[step], sets.begins[step + 1]):
            join(union, Piece(sets.uppers[i], sets.lowers[i]), TOUCHING)
        rests.extend([(rest[0], rest[1]) for rest in sets.rests[step]])
    if task.velocity == 0.0 and is_symmetric(task.plant):
        for i in range(len(union.uppers)):
            add(union, mirrored(Piece(union.uppers[i], union.lowers[i])))
    return union, union_of_intervals(rests)
