"""One step of the reachable set: its parts go through the regimes of the friction law.

What the sets are made of is in polylines.py, what comes of many steps in reachability.py.
"""

import math
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import Regime, breaking_away, can_rest, sliding
from app.planning.plant.system import Plant
from app.planning.reachable.curves import bent, straightening, thinned
from app.planning.reachable.polylines import (
    TOUCHING,
    Piece,
    Pieces,
    add,
    cut,
    cut_piece,
    extent,
    image,
    is_empty,
    join,
    mirrored,
    no_pieces,
    spans,
    union_of_intervals,
)

DIRECTIONS = (1.0, -1.0)
ROUNDING = 1e-10
"""Relative; what it does to velocities on the way, in m/s."""
_MAX_PIECES = 32
"""Pieces of the reachable set beyond which the narrowest holes between them are filled."""
_FILLED = 1e-9
"""Width (m) of the holes that are filled first."""
_WIDEST = 1e12
"""Above any hole (m) between positions that are no farther than LARGEST."""


class ReachableSet(NamedTuple):
    """All states after some number of steps: position (m) over velocity (m/s)."""

    pieces: Pieces
    rests: FloatArray
    """Intervals of positions at rest, (R, 2), disjoint and in order."""
    inexact: float
    """How far from a state of the set the true ones may be, m: what was filled or straightened."""


@compiled
def advance(states: ReachableSet, symmetric: bool, horizon: int, plant: Plant) -> ReachableSet:
    """Return the set one step later; there are `horizon` of them in all.

    Of a `symmetric` set, the pieces hold the half with v >= 0, before and after.
    """
    before, pieces = states.pieces, no_pieces()
    stays = can_rest(plant)
    rests = [(rest[0], rest[1]) for rest in states.rests[: len(states.rests) if stays else 0]]
    for i in range(len(before.uppers)):
        piece = Piece(before.uppers[i], before.lowers[i])
        at_rest = _band(piece, plant.velocity_threshold)
        if is_empty(at_rest):
            continue
        if stays:
            rests.append(extent(at_rest))
        _break_away(pieces, at_rest, symmetric, plant)
        if symmetric:
            at_rest = mirrored(at_rest)
            if stays:
                rests.append(extent(at_rest))
            _break_away(pieces, at_rest, symmetric, plant)
    for rest in states.rests:
        _break_away(pieces, _resting(rest[0], rest[1]), symmetric, plant)
    for i in range(len(before.uppers)):
        piece = Piece(before.uppers[i], before.lowers[i])
        _slide(pieces, rests, piece, 1.0, horizon, plant)
        if not symmetric:
            _slide(pieces, rests, piece, -1.0, horizon, plant)
    if symmetric:
        for i in range(len(rests)):
            rests.append((-rests[i][1], -rests[i][0]))
    inexact = states.inexact
    if plant.stribeck_velocity > 0.0:
        tolerance = straightening(horizon, plant)
        inexact += 2.0 * tolerance
        pieces = _thin(pieces, tolerance)
    pieces, filled = _few(pieces)
    return ReachableSet(pieces, union_of_intervals(rests), inexact + 0.5 * filled)


@compiled
def _few(pieces: Pieces) -> tuple[Pieces, float]:
    """Return the pieces, the narrowest holes between them filled as long as there are too many.

    Also returns the width (m) of the widest hole that was.
    """
    gap, filled = _FILLED, 0.0
    while len(pieces.uppers) > _MAX_PIECES and gap < _WIDEST:
        fewer = no_pieces()
        for i in range(len(pieces.uppers)):
            join(fewer, Piece(pieces.uppers[i], pieces.lowers[i]), gap)
        pieces = fewer
        filled, gap = gap, 10.0 * gap
    if len(pieces.uppers) > _MAX_PIECES:
        # Velocities so near to each other that no two pieces share any: one box holds them all.
        return _box(pieces)
    return pieces, filled


@compiled
def _box(pieces: Pieces) -> tuple[Pieces, float]:
    """Return the piece of all positions and velocities between those of `pieces`.

    Also returns twice how far a state of it may be from theirs, about: its extent.
    """
    slowest, fastest, low, high = math.inf, -math.inf, math.inf, -math.inf
    for i in range(len(pieces.uppers)):
        line = pieces.uppers[i]
        lowest, highest = extent(Piece(line, pieces.lowers[i]))
        slowest, fastest = min(slowest, line[0, 0]), max(fastest, line[-1, 0])
        low, high = min(low, lowest), max(high, highest)
    upper, lower = np.empty((2, 2)), np.empty((2, 2))
    upper[0, 0], upper[1, 0] = slowest, fastest
    lower[0, 0], lower[1, 0] = slowest, fastest
    upper[:, 1], lower[:, 1] = high, -low
    box = no_pieces()
    add(box, Piece(upper, lower))
    return box, 2.0 * (high - low + fastest - slowest)


@compiled
def _thin(pieces: Pieces, tolerance: float) -> Pieces:
    """Return pieces with as few vertices as `tolerance` (m) lets them have."""
    thin = no_pieces()
    for i in range(len(pieces.uppers)):
        upper = thinned(pieces.uppers[i], tolerance)
        add(thin, Piece(upper, thinned(pieces.lowers[i], tolerance)))
    return thin


@compiled
def _resting(low: float, high: float) -> Piece:
    """Return an interval of positions at rest as a piece."""
    upper, lower = np.zeros((1, 2)), np.zeros((1, 2))
    upper[0, 1], lower[0, 1] = high, -low
    return Piece(upper, lower)


@compiled
def _band(piece: Piece, threshold: float) -> Piece:
    """Return the part of a piece with |v| < `threshold`; its ends are limits from inside."""
    return Piece(_band_of_line(piece.upper, threshold), _band_of_line(piece.lower, threshold))


@compiled
def _band_of_line(line: FloatArray, threshold: float) -> FloatArray:
    part = cut(line, -threshold, threshold)
    first, last = 0, part.shape[0] - 1
    while first < last and part[first + 1, 0] == -threshold:
        first += 1
    while first < last and part[last - 1, 0] == threshold:
        last -= 1
    inside = (1.0 - ROUNDING) * threshold
    if first <= last and (part[first, 0] >= inside or part[last, 0] <= -inside):
        # A push that just breaks a mass away may end as fast as the threshold, but never slower.
        return part[:0]
    return part[first : last + 1]


@compiled
def _through(piece: Piece, regime: Regime, time_step: float) -> Piece:
    """Return where a regime takes a piece: positions move by the velocity after the step."""
    return Piece(
        image(piece.upper, regime.retained, regime.low, regime.high, time_step),
        image(piece.lower, regime.retained, regime.low, regime.high, -time_step),
    )


@compiled
def _break_away(pieces: Pieces, at_rest: Piece, half: bool, plant: Plant) -> None:
    """Add what breaks away from a piece at rest, in either direction; its `half` with v >= 0."""
    for direction in DIRECTIONS:
        regime = breaking_away(direction, plant)
        is_other_half = half and at_rest.upper[-1, 0] + regime.high < 0.0
        if regime.low > regime.high or is_other_half:
            continue
        moving = _through(at_rest, regime, plant.time_step)
        if half:
            moving = cut_piece(moving, 0.0, math.inf)
        # Nothing but v = 0 may be left, which is at rest already.
        if spans(moving):
            join(pieces, moving, TOUCHING)


@compiled
def _slide(
    pieces: Pieces,
    rests: list[tuple[float, float]],
    piece: Piece,
    direction: float,
    horizon: int,
    plant: Plant,
) -> None:
    """Add where the part of a piece that slides in a direction goes, or stops."""
    regime = sliding(direction, plant)
    forward = direction > 0.0
    begin, end = plant.velocity_threshold, math.inf
    piece = cut_piece(piece, begin, end) if forward else cut_piece(piece, -end, -begin)
    if is_empty(piece):
        return
    if plant.stribeck_velocity > 0.0:
        piece = bent(piece, direction, horizon, plant)
        regime = Regime(1.0, regime.low, regime.high)
    slowest = piece.upper[0, 0] if forward else -piece.upper[-1, 0]
    push = regime.high if forward else -regime.low
    if push <= 0.0 or regime.retained * slowest + push <= 0.0:
        # No control holds the speed, so v need not lie in the window of w = 0 to be stopped.
        if forward:
            stopped = cut_piece(piece, -math.inf, -regime.low / regime.retained)
        else:
            stopped = cut_piece(piece, -regime.high / regime.retained, math.inf)
        if not is_empty(stopped):
            rests.append(extent(stopped))
    moving = _through(piece, regime, plant.time_step)
    moving = cut_piece(moving, 0.0, math.inf) if forward else cut_piece(moving, -math.inf, 0.0)
    if spans(moving):
        join(pieces, moving, TOUCHING)
