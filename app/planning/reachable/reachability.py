"""What a plan can reach at best: the exact reachable set of the plant, and the floor of the error.

Nothing here plans: no controls are computed, only the states that some controls would reach.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.compilation import compiled
from app.planning.plant.system import FloatArray, Parameters
from app.planning.problem import Problem
from app.planning.stop import NEVER, Flag, Stop

REACHABLE_WITHIN = 1e-9
"""A target this close to the reachable set counts as in it (m and m/s in one Euclidean norm).

Relative to the largest coordinate of start and target where that exceeds one.
"""

_TOUCHING = 1e-13
"""Slices (m) whose gap is smaller overlap; what rounding alone tears apart."""

_SLIVER = 1e-12
"""Ranges of velocity (m/s) that are narrower are not told apart."""

_MAX_PIECES = 32
"""Pieces of the reachable set beyond which the narrowest holes between them are filled."""

_FILLED = 1e-9
"""Width (m) of the holes that are filled first."""

_COLLINEAR = 1e-15
"""Vertices (m) this near to the line between their neighbours are dropped."""


@dataclass(frozen=True, slots=True)
class Reachability:
    """How near to its target a problem can end, whatever the method."""

    reachable: bool
    """Whether the floor is zero, to within `REACHABLE_WITHIN`."""
    floor: float
    """Least terminal error ||x_H - x*||_2 over all admissible controls."""
    nearest_state: FloatArray
    """Terminal state [p, v] (2,) at that distance, in m and m/s."""
    minimum_steps: int | None
    """Fewest steps, at most H, that lead to a target that is reachable in H; None if it is not.

    0 if the target is the start. A plan that takes this few steps need not end with a wait: whether
    the target can also be reached in every number of steps up to H is another question.
    """


def reachability(problem: Problem, stop: Stop = NEVER) -> Reachability:
    r"""Return how near to its target `problem` can end, in the exact discrete dynamics of `step`.

    One step chooses the next velocity w from a set V(v), and the position follows: p' = p + dt*w.
    With a = 1 - b*dt,

    - sliding, v >= eps_v:  w = max(0, a*v + s),  s in dt*[-u_max - f_c, u_max - f_c];
    - sliding, v <= -eps_v: its mirror image;
    - at rest, |v| < eps_v: w = 0 (stuck), or, if u_max > f_s, w = v +- s with
      s in dt*(f_s - f_c, u_max - f_c] (breaking away; the gap up to dt*(f_s - f_c) is the dead
      zone).

    So let X_n be the set of states after exactly n steps, and X_n(w) its slice of positions at
    velocity w. One step, in one of these regimes r, is

        X_{n+1}(w) = dt*w + union over v in [(w - hi_r)/a_r, (w - lo_r)/a_r] of X_n(v),

    with v also in the band of velocities of that regime. If every slice of a connected piece of
    X_n is an interval [L(v), U(v)], the union is the interval between the least L and the greatest
    U in that window, and the image is such a piece again: the upper bound is the Minkowski sum of
    the hypograph of U with the segment [lo_r, hi_r], which moves its rising edges by lo_r and its
    falling edges by hi_r (a bang-bang control, switched at the peak). A piece is therefore two
    polylines over v, exact, with some two vertices more each step.

    A step cuts each piece at v = +-eps_v, maps the parts through their regimes, and joins images
    where their slices overlap. Holes, which the dead zone leaves near the start, keep pieces apart
    until enough hops fill them. States at rest, v = 0, are intervals of their own: what enters the
    band |v| < eps_v may stop there and wait. Stops, waits, reversals and passages through the band
    without a stop are thus all covered, in any number. Only beyond `_MAX_PIECES` pieces (seen where
    u_max is barely above f_s and eps_v at least twice the dead zone, so that breaking away takes
    several steps inside the band) are the narrowest holes filled; the floor is then a lower bound,
    and a target in such a hole counts as reachable.

    The floor is the distance from the target to X_H. Open ends (the dead zone, the band) are
    treated as closed, so it is an infimum that may be approached only.

    The cost grows with the square of the horizon. Propagation ends early where X_n can only grow
    (a start at v = 0 can wait) or a target can be held (v* = 0).

    Raises:
        Stopped: `stop` said so.
    """
    start, target = problem.initial_state, problem.target_state
    scale = max(1.0, float(np.abs(start).max()), float(np.abs(target).max()))
    # In displacements from the start, so that its size costs no digits.
    steps, floor, displacement, velocity = _propagate(
        float(start[1]),
        float(target[0] - start[0]),
        float(target[1]),
        problem.horizon,
        REACHABLE_WITHIN * scale,
        problem.system.parameters,
        stop.flag,
    )
    stop.check()
    reachable = floor <= REACHABLE_WITHIN * scale
    return Reachability(
        reachable=reachable,
        floor=floor,
        nearest_state=np.array([start[0] + displacement, velocity]),
        minimum_steps=steps if reachable else None,
    )


# A piece is a pair of polylines of rows (v, y), v not decreasing and jumps as two rows of equal v:
# `upper` holds y = U(v) and `lower` y = -L(v), so that both are maxima and one kernel serves both.


@compiled
def _propagate(
    initial_velocity: float,
    target_displacement: float,
    target_velocity: float,
    horizon: int,
    tolerance: float,
    parameters: Parameters,
    stopped: Flag,
) -> tuple[int, float, float, float]:
    """Return the first step within `tolerance` (-1: none), the floor and the nearest state."""
    uppers, lowers = [np.empty((1, 2))], [np.empty((1, 2))]
    uppers[0][0, 0], uppers[0][0, 1] = initial_velocity, 0.0
    lowers[0][0, 0], lowers[0][0, 1] = initial_velocity, 0.0
    rests = np.empty((0, 2))
    # What is reached from a standstill is its own mirror image: half of it tells all.
    symmetric = initial_velocity == 0.0
    if symmetric:
        rests = np.zeros((1, 2))
        uppers.clear()
        lowers.clear()
    first, floor, nearest_p, nearest_v = -1, math.inf, 0.0, 0.0
    for n in range(horizon + 1):
        if stopped[0]:
            break
        if n > 0:
            uppers, lowers, rests = _advance(uppers, lowers, rests, symmetric, parameters)
        within = math.inf if n == horizon else tolerance
        floor, nearest_p, nearest_v = _nearest(
            uppers, lowers, rests, target_displacement, target_velocity, within
        )
        if symmetric:
            other, other_p, other_v = _nearest(
                uppers, lowers, rests, -target_displacement, -target_velocity, within
            )
            if other < floor:
                floor, nearest_p, nearest_v = other, -other_p, -other_v
        if first < 0 and floor <= tolerance:
            first = n
            if symmetric or target_velocity == 0.0:
                break
    return first, floor, nearest_p, nearest_v


@compiled
def _advance(
    uppers: list[FloatArray],
    lowers: list[FloatArray],
    rests: FloatArray,
    symmetric: bool,
    parameters: Parameters,
) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Return the pieces and the rest positions one step later.

    Of a `symmetric` set, the pieces hold the half with v >= 0, before and after.
    """
    threshold = parameters[5]
    next_uppers, next_lowers = [rests], [rests]
    next_uppers.clear()
    next_lowers.clear()
    next_rests = [(rest[0], rest[1]) for rest in rests]
    for i in range(len(uppers)):
        upper, lower = _band(uppers[i], threshold), _band(lowers[i], threshold)
        if upper.shape[0] == 0:
            continue
        next_rests.append((-lower[:, 1].max(), upper[:, 1].max()))
        _break_away(next_uppers, next_lowers, upper, lower, symmetric, parameters)
        if symmetric:
            upper, lower = _mirrored(lower), _mirrored(upper)
            next_rests.append((-lower[:, 1].max(), upper[:, 1].max()))
            _break_away(next_uppers, next_lowers, upper, lower, symmetric, parameters)
    for i in range(rests.shape[0]):
        upper, lower = np.zeros((1, 2)), np.zeros((1, 2))
        upper[0, 1], lower[0, 1] = rests[i, 1], -rests[i, 0]
        _break_away(next_uppers, next_lowers, upper, lower, symmetric, parameters)
    for i in range(len(uppers)):
        _slide(next_uppers, next_lowers, next_rests, uppers[i], lowers[i], 1.0, parameters)
        if not symmetric:
            _slide(next_uppers, next_lowers, next_rests, uppers[i], lowers[i], -1.0, parameters)
    gap = _FILLED
    while len(next_uppers) > _MAX_PIECES and gap < 1.0:
        crowd_uppers, crowd_lowers = next_uppers.copy(), next_lowers.copy()
        next_uppers.clear()
        next_lowers.clear()
        for i in range(len(crowd_uppers)):
            _join(next_uppers, next_lowers, crowd_uppers[i], crowd_lowers[i], gap)
        gap = 10.0 * gap
    if symmetric:
        for i in range(len(next_rests)):
            next_rests.append((-next_rests[i][1], -next_rests[i][0]))
    return next_uppers, next_lowers, _merged(next_rests)


@compiled
def _break_away(
    uppers: list[FloatArray],
    lowers: list[FloatArray],
    upper: FloatArray,
    lower: FloatArray,
    half: bool,
    parameters: Parameters,
) -> None:
    """Add what breaks away from a piece at rest, in either direction; its `half` with v >= 0."""
    static, coulomb, _, limit, time_step, _ = parameters
    if limit <= static:
        return
    slow, fast = time_step * (static - coulomb), time_step * (limit - coulomb)
    for low, high in ((slow, fast), (-fast, -slow)):
        image = _image(upper, 1.0, low, high, time_step)
        image_lower = _image(lower, 1.0, low, high, -time_step)
        if half:
            image, image_lower = _cut(image, 0.0, math.inf), _cut(image_lower, 0.0, math.inf)
        # Nothing but v = 0 may be left, which is at rest already.
        if image.shape[0] > 0 and image[0, 0] < image[-1, 0]:
            _join(uppers, lowers, image, image_lower, _TOUCHING)


@compiled
def _slide(
    uppers: list[FloatArray],
    lowers: list[FloatArray],
    rests: list[tuple[float, float]],
    upper: FloatArray,
    lower: FloatArray,
    sign: float,
    parameters: Parameters,
) -> None:
    """Add where the part of a piece that slides in the direction of `sign` goes, or stops."""
    _, coulomb, damping, limit, time_step, threshold = parameters
    retained = 1.0 - time_step * damping
    fast, brake = time_step * (limit - coulomb), time_step * (limit + coulomb)
    low, high = (-brake, fast) if sign > 0 else (-fast, brake)
    begin, end = (threshold, math.inf) if sign > 0 else (-math.inf, -threshold)
    upper, lower = _cut(upper, begin, end), _cut(lower, begin, end)
    if upper.shape[0] == 0:
        return
    if fast <= 0.0:
        # No control holds the speed, so v need not lie in the window of w = 0 to be stopped.
        reach = brake / retained
        begin, end = (-math.inf, reach) if sign > 0 else (-reach, math.inf)
        stopped, stopped_lower = _cut(upper, begin, end), _cut(lower, begin, end)
        if stopped.shape[0] > 0:
            rests.append((-stopped_lower[:, 1].max(), stopped[:, 1].max()))
    upper = _image(upper, retained, low, high, time_step)
    lower = _image(lower, retained, low, high, -time_step)
    begin, end = (0.0, math.inf) if sign > 0 else (-math.inf, 0.0)
    upper, lower = _cut(upper, begin, end), _cut(lower, begin, end)
    if upper.shape[0] > 0 and upper[0, 0] < upper[-1, 0]:
        _join(uppers, lowers, upper, lower, _TOUCHING)


@compiled
def _mirrored(line: FloatArray) -> FloatArray:
    """Return `line` for -v; the upper line of the mirror image of a piece is its lower, so."""
    mirrored = line[::-1].copy()
    mirrored[:, 0] = -mirrored[:, 0]
    return mirrored


@compiled
def _at(line: FloatArray, i: int, v: float) -> float:
    """Return the height at `v` of the edge from row `i`, which is not vertical."""
    v0, v1, y0, y1 = line[i, 0], line[i + 1, 0], line[i, 1], line[i + 1, 1]
    if v == v0:
        return float(y0)
    if v == v1:
        return float(y1)
    return float(y0 + (y1 - y0) * ((v - v0) / (v1 - v0)))


@compiled
def _count(line: FloatArray, v: float, inclusive: bool) -> int:
    """Return how many rows lie before `v`, or, if `inclusive`, not after it."""
    low, high = 0, line.shape[0]
    while low < high:
        middle = (low + high) // 2
        if line[middle, 0] < v or (inclusive and line[middle, 0] == v):
            low = middle + 1
        else:
            high = middle
    return low


@compiled
def _cut(line: FloatArray, low: float, high: float) -> FloatArray:
    """Return the part of `line` with `low` <= v <= `high`, jumps at either end included."""
    n = line.shape[0]
    if line[0, 0] > high or line[n - 1, 0] < low:
        return line[:0]
    begin, end = _count(line, low, False), _count(line, high, True)
    part = np.empty((end - begin + 2, 2))
    m = 0
    if begin > 0 and (begin == n or line[begin, 0] > low):
        part[m, 0], part[m, 1] = low, _at(line, begin - 1, low)
        m += 1
    for i in range(begin, end):
        part[m, 0], part[m, 1] = line[i, 0], line[i, 1]
        m += 1
    if end < n and (end == 0 or line[end - 1, 0] < high):
        part[m, 0], part[m, 1] = high, _at(line, end - 1, high)
        m += 1
    return part[:m]


@compiled
def _band(line: FloatArray, threshold: float) -> FloatArray:
    """Return the part of `line` with |v| < `threshold`; its ends are limits from inside."""
    part = _cut(line, -threshold, threshold)
    first, last = 0, part.shape[0] - 1
    while first < last and part[first + 1, 0] == -threshold:
        first += 1
    while first < last and part[last - 1, 0] == threshold:
        last -= 1
    if first <= last and part[first, 0] == part[last, 0] and abs(part[first, 0]) >= threshold:
        return part[:0]
    return part[first : last + 1]


@compiled
def _image(line: FloatArray, retained: float, low: float, high: float, slope: float) -> FloatArray:
    """Return w -> slope*w + the maximum of `line` over the v with `low` <= w - a*v <= `high`."""
    n = line.shape[0]
    start = 0
    image = line[:0]
    while True:
        # Each hill on its own: its rising edges move by `low`, its falling ones by `high`.
        top = start
        while top + 1 < n and line[top + 1, 1] >= line[top, 1]:
            top += 1
        end = top
        while end + 1 < n and line[end + 1, 1] <= line[end, 1]:
            end += 1
        hill = np.empty((end - start + 2, 2))
        for i in range(start, end + 2):
            row, shift = (i, low) if i <= top else (i - 1, high)
            w = retained * line[row, 0] + shift
            hill[i - start, 0] = w
            hill[i - start, 1] = line[row, 1] + slope * w
        image = hill if start == 0 else _maximum(image, hill)
        if end == n - 1:
            return image
        start = end


@compiled
def _append(line: FloatArray, m: int, v: float, y: float) -> int:
    """Write (v, y) after the `m` rows of `line`, in place of a row on the way; return the count."""
    if m > 0 and line[m - 1, 0] == v and line[m - 1, 1] == y:
        return m
    if m > 1:
        v0, y0, v1, y1 = line[m - 2, 0], line[m - 2, 1], line[m - 1, 0], line[m - 1, 1]
        off = (v1 - v0) * (y - y0) - (v - v0) * (y1 - y0)
        if v0 < v1 < v and abs(off) <= _COLLINEAR * (v - v0):
            m -= 1
    line[m, 0], line[m, 1] = v, y
    return m + 1


@compiled
def _maximum(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the greater of two lines whose domains overlap, over the union of the domains."""
    na, nb = a.shape[0], b.shape[0]
    begin, end = max(a[0, 0], b[0, 0]), min(a[na - 1, 0], b[nb - 1, 0])
    line = np.empty((3 * (na + nb) + 2, 2))
    m = 0
    # Before and after the common domain, the one that is there.
    early = a if a[0, 0] < b[0, 0] else b
    count = _count(early, begin, False)
    for k in range(count):
        line[k, 0], line[k, 1] = early[k, 0], early[k, 1]
    m = count
    if count > 0:
        m = _append(line, m, begin, _at(early, count - 1, begin))
    i, j = _count(a, begin, True) - 1, _count(b, begin, True) - 1
    v = begin
    while v < end:
        while a[i + 1, 0] <= v:
            i += 1
        while b[j + 1, 0] <= v:
            j += 1
        following = min(a[i + 1, 0], b[j + 1, 0])
        a0, a1 = _at(a, i, v), _at(a, i, following)
        b0, b1 = _at(b, j, v), _at(b, j, following)
        m = _append(line, m, v, max(a0, b0))
        if (a0 - b0) * (a1 - b1) < 0.0:
            share = (a0 - b0) / ((a0 - b0) - (a1 - b1))
            crossing = v + share * (following - v)
            if v < crossing < following:
                m = _append(line, m, crossing, a0 + share * (a1 - a0))
        m = _append(line, m, following, max(a1, b1))
        v = following
    late = a if a[na - 1, 0] > b[nb - 1, 0] else b
    count = _count(late, end, True)
    if count < late.shape[0]:
        m = _append(line, m, end, _at(late, count - 1, end))
        for k in range(count, late.shape[0]):
            line[m, 0], line[m, 1] = late[k, 0], late[k, 1]
            m += 1
    return line[:m].copy()


@compiled
def _above(
    upper: FloatArray, i: int, lower: FloatArray, j: int, v: float, following: float, gap: float
) -> tuple[float, float]:
    """Return where between `v` and `following` the edges from rows `i` and `j` are in order.

    That is, where the upper one is at most `gap` below the lower one; empty if nowhere.
    """
    before = gap + _at(upper, i, v) + _at(lower, j, v)
    after = gap + _at(upper, i, following) + _at(lower, j, following)
    if before >= 0.0 and after >= 0.0:
        return v, following
    if before < 0.0 and after < 0.0:
        return following, v
    crossing = v + (following - v) * (before / (before - after))
    return (crossing, following) if before < 0.0 else (v, crossing)


@compiled
def _shared(
    upper: FloatArray, lower: FloatArray, other: FloatArray, other_lower: FloatArray, gap: float
) -> tuple[float, float]:
    """Return the first range of v in which the slices of two pieces are at most `gap` apart.

    Empty (its end not above its start) if there is none.
    """
    v = max(upper[0, 0], other[0, 0])
    end = min(upper[-1, 0], other[-1, 0])
    low, high = math.inf, -math.inf
    if v >= end:
        return low, high
    i, j = _count(upper, v, True) - 1, _count(lower, v, True) - 1
    k, n = _count(other, v, True) - 1, _count(other_lower, v, True) - 1
    while v < end:
        while upper[i + 1, 0] <= v:
            i += 1
        while lower[j + 1, 0] <= v:
            j += 1
        while other[k + 1, 0] <= v:
            k += 1
        while other_lower[n + 1, 0] <= v:
            n += 1
        following = min(upper[i + 1, 0], lower[j + 1, 0], other[k + 1, 0], other_lower[n + 1, 0])
        first, last = _above(upper, i, other_lower, n, v, following, gap)
        if first <= last:
            begin, finish = _above(other, k, lower, j, v, following, gap)
            first, last = max(first, begin), min(last, finish)
        if (first > v or last < first) and high - low > _SLIVER:
            return low, high
        if first > v or high < v:
            low = first
        high = last
        if last < following:
            if last - low > _SLIVER:
                return low, high
            low, high = math.inf, -math.inf
        v = following
    return low, high


@compiled
def _join(
    uppers: list[FloatArray],
    lowers: list[FloatArray],
    upper: FloatArray,
    lower: FloatArray,
    gap: float,
) -> None:
    """Add a piece to the lists, as one with those whose slices are at most `gap` apart from its.

    Where they are so for some v only, the piece is cut there and its rest stays apart.
    """
    rest_uppers, rest_lowers = [upper], [lower]
    while len(rest_uppers) > 0:
        upper, lower = rest_uppers.pop(), rest_lowers.pop()
        i = 0
        while i < len(uppers):
            low, high = _shared(uppers[i], lowers[i], upper, lower, gap)
            if high - low <= _SLIVER:
                i += 1
                continue
            if low > max(uppers[i][0, 0], upper[0, 0]) + _SLIVER:
                rest_uppers.append(_cut(upper, -math.inf, low))
                rest_lowers.append(_cut(lower, -math.inf, low))
                upper, lower = _cut(upper, low, math.inf), _cut(lower, low, math.inf)
            if high < min(uppers[i][-1, 0], upper[-1, 0]) - _SLIVER:
                rest_uppers.append(_cut(upper, high, math.inf))
                rest_lowers.append(_cut(lower, high, math.inf))
                upper, lower = _cut(upper, -math.inf, high), _cut(lower, -math.inf, high)
            upper, lower = _maximum(uppers[i], upper), _maximum(lowers[i], lower)
            # Numba's list.pop(i) releases the wrong reference.
            uppers[i], lowers[i] = uppers[-1], lowers[-1]
            uppers.pop()
            lowers.pop()
            i = 0
        uppers.append(upper)
        lowers.append(lower)


@compiled
def _merged(intervals: list[tuple[float, float]]) -> FloatArray:
    """Return the union of intervals as disjoint ones (R, 2), in order."""
    intervals.sort()
    union = np.empty((len(intervals), 2))
    m = 0
    for low, high in intervals:
        if m > 0 and low <= union[m - 1, 1] + _TOUCHING:
            union[m - 1, 1] = max(union[m - 1, 1], high)
        else:
            union[m, 0], union[m, 1] = low, high
            m += 1
    return union[:m]


@compiled
def _nearest(
    uppers: list[FloatArray],
    lowers: list[FloatArray],
    rests: FloatArray,
    p: float,
    v: float,
    within: float,
) -> tuple[float, float, float]:
    """Return the distance from (p, v), and the nearest state; inf if farther than `within`."""
    best, best_p, best_v = math.inf, math.nan, math.nan
    for i in range(rests.shape[0]):
        rest = min(max(p, rests[i, 0]), rests[i, 1])
        distance = math.hypot(p - rest, v)
        if distance <= within and distance < best:
            best, best_p, best_v = distance, rest, 0.0
    for i in range(len(uppers)):
        upper, lower = uppers[i], lowers[i]
        first, last = upper[0, 0], upper[-1, 0]
        if max(first - v, v - last, 0.0) > min(within, best):
            continue
        if _below(p, v, upper) and _below(-p, v, lower):
            return 0.0, p, v
        # Down the upper line, up the lower one, and the two ends between them.
        for line, sign in ((upper, 1.0), (lower, -1.0)):
            for k in range(line.shape[0]):
                p0, v0 = sign * line[k, 1], line[k, 0]
                if k + 1 < line.shape[0]:
                    p1, v1 = sign * line[k + 1, 1], line[k + 1, 0]
                elif sign > 0:
                    p1, v1 = -lower[-1, 1], last
                else:
                    p1, v1 = upper[0, 1], first
                    p0, v0 = -lower[0, 1], first
                length = (p1 - p0) ** 2 + (v1 - v0) ** 2
                share = 0.0
                if length > 0.0:
                    share = ((p - p0) * (p1 - p0) + (v - v0) * (v1 - v0)) / length
                    share = min(max(share, 0.0), 1.0)
                near_p, near_v = p0 + share * (p1 - p0), v0 + share * (v1 - v0)
                distance = math.hypot(p - near_p, v - near_v)
                if distance <= within and distance < best:
                    best, best_p, best_v = distance, near_p, near_v
    return best, best_p, best_v


@compiled
def _below(y: float, v: float, line: FloatArray) -> bool:
    """Return whether (v, y) lies on or under `line`."""
    for i in range(line.shape[0] - 1):
        if line[i, 0] <= v <= line[i + 1, 0]:
            if line[i, 0] == line[i + 1, 0]:
                if y <= max(line[i, 1], line[i + 1, 1]):
                    return True
            elif y <= _at(line, i, v):
                return True
    return False
