"""Edges that bend: what Stribeck's effect makes of polylines, to within a tolerance.

A sliding mass keeps a part of its velocity that is not in proportion to it, so straight edges
become curves. They are made of straight ones again: as many as needed here, and no more there.
"""

import math

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import friction_of, kept_velocity
from app.planning.plant.system import Plant
from app.planning.reachable.polylines import Piece, with_vertex

_FADED = 6.0
"""Velocities above this many v_s slide without Stribeck's effect: exp(-36) is below rounding."""
_STEEPEST_BEND = 2.0
"""The greatest second derivative of exp(-x^2)."""
STRAIGHT = 8e-7
"""m: what edges lose over all steps where they are made straight and thinned, on usual plants."""
_MAX_PARTS = 4096
"""Straight edges that all of a curve is made of, at most."""


@compiled
def straightening(horizon: int, plant: Plant) -> float:
    """Return what an edge may lose at once, m: it is straightened and thinned in each step.

    That is a share of `STRAIGHT`, or more where a curve would need too many edges for it.
    """
    if plant.stribeck_velocity == 0.0:
        return 0.0
    forward, backward = friction_of(1.0, plant), friction_of(-1.0, plant)
    excess = max(forward.static - forward.coulomb, backward.static - backward.coulomb)
    bend = plant.time_step * excess * _STEEPEST_BEND * _steepest(horizon, plant)
    return max(STRAIGHT / (2.0 * horizon), bend * (_FADED / _MAX_PARTS) ** 2 / 8.0)


@compiled
def _steepest(horizon: int, plant: Plant) -> float:
    """Return the slope (s) from which on an edge counts as upright.

    There a velocity that is off counts by what it moves over the time that is left.
    """
    return 1.0 + horizon * plant.time_step


@compiled
def bent(piece: Piece, direction: float, horizon: int, plant: Plant) -> Piece:
    """Return a piece over what each of its velocities keeps in a step (`kept_velocity`)."""
    return Piece(
        _bent_line(piece.upper, direction, horizon, plant),
        _bent_line(piece.lower, direction, horizon, plant),
    )


@compiled
def _bent_line(line: FloatArray, direction: float, horizon: int, plant: Plant) -> FloatArray:
    """Return (kept(v), y) of a line (v, y), with more vertices where that bends.

    Between two vertices h apart the curve is off its chord by h^2 kept''/8 in velocity, and by that
    times the slope dy/dw, w = kept(v), in y.
    """
    friction, scale = friction_of(direction, plant), plant.stribeck_velocity
    excess = friction.static - friction.coulomb
    bend = plant.time_step * excess * _STEEPEST_BEND / scale**2
    line = with_vertex(line, direction * _FADED * scale)
    steepest, loss = _steepest(horizon, plant), straightening(horizon, plant)
    steps = np.ones(line.shape[0], dtype=np.int64)
    for i in range(line.shape[0] - 1):
        v0, v1 = line[i, 0], line[i + 1, 0]
        kept = kept_velocity(v1, direction, plant) - kept_velocity(v0, direction, plant)
        if kept > 0.0 and max(abs(v0), abs(v1)) <= _FADED * scale:
            slope = min(steepest, abs(line[i + 1, 1] - line[i, 1]) / kept)
            parts = (v1 - v0) * math.sqrt(slope * bend / (8.0 * loss))
            steps[i] = max(1, math.ceil(parts))
    curve = np.empty((steps[:-1].sum() + 1, 2))
    m = 0
    for i in range(line.shape[0] - 1):
        v0, v1, y0, y1 = line[i, 0], line[i + 1, 0], line[i, 1], line[i + 1, 1]
        for part in range(steps[i]):
            share = part / steps[i]
            curve[m, 0] = kept_velocity(v0 + share * (v1 - v0), direction, plant)
            curve[m, 1] = y0 + share * (y1 - y0)
            m += 1
    curve[m, 0] = kept_velocity(line[-1, 0], direction, plant)
    curve[m, 1] = line[-1, 1]
    return curve


@compiled
def thinned(line: FloatArray, tolerance: float) -> FloatArray:
    """Return a line without the vertices that it can lack, off by at most `tolerance` in y.

    From each vertex that is kept, a straight edge goes on to the last one such that it passes all
    between by at most the tolerance (Reumann and Witkam's corridor, as a cone of slopes).
    """
    n = line.shape[0]
    kept = np.empty((n, 2))
    kept[0] = line[0]
    m, anchor = 1, 0
    low, high = -math.inf, math.inf
    for i in range(1, n):
        along = line[i, 0] - line[anchor, 0]
        if along > 0.0:
            rise = line[i, 1] - line[anchor, 1]
            slope = rise / along
            fits = i - anchor == 1 or (line[i, 0] > line[i - 1, 0] and low <= slope <= high)
        else:
            fits = i - anchor == 1
        if not fits:
            anchor = i - 1
            kept[m] = line[anchor]
            m += 1
            low, high = -math.inf, math.inf
            along = line[i, 0] - line[anchor, 0]
            rise = line[i, 1] - line[anchor, 1]
        if along > 0.0:
            low = max(low, (rise - tolerance) / along)
            high = min(high, (rise + tolerance) / along)
        else:
            # A jump ends what can be straight.
            low, high = math.inf, -math.inf
    kept[m] = line[n - 1]
    return kept[: m + 1].copy() if n > 1 else line
