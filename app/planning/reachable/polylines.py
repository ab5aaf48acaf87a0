"""Polylines over an axis, and pieces of the plane between two of them: geometry without physics.

A polyline is rows (v, y), v not decreasing, jumps as two rows of equal v.
"""

import math
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray

TOUCHING = 1e-13
"""Slices whose gap is smaller overlap; what rounding alone tears apart."""

_SLIVER = 1e-12
"""Ranges of v that are narrower are not told apart."""

_COLLINEAR = 1e-15
"""Vertices this near to the line between their neighbours are dropped."""


class Piece(NamedTuple):
    """A connected set whose slices are intervals: -lower(v) <= y <= upper(v), over one range of v.

    The lower edge is kept with its sign turned: so both are maxima, and one kernel serves both.
    """

    upper: FloatArray
    lower: FloatArray


class Pieces(NamedTuple):
    """Pieces, as two lists side by side: Numba never frees what a list of pairs holds."""

    uppers: list[FloatArray]
    lowers: list[FloatArray]


@compiled
def no_pieces() -> Pieces:
    """Return an empty list of pieces."""
    # Not by list.clear(): Numba never frees what that removes.
    return Pieces([np.empty((1, 2)) for _ in range(0)], [np.empty((1, 2)) for _ in range(0)])


@compiled
def add(pieces: Pieces, piece: Piece) -> None:
    """Add a piece, apart from those that are there."""
    pieces.uppers.append(piece.upper)
    pieces.lowers.append(piece.lower)


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
def cut(line: FloatArray, low: float, high: float) -> FloatArray:
    """Return the part of `line` with `low` <= v <= `high`, jumps at either end included."""
    n = line.shape[0]
    if line[0, 0] > high or line[n - 1, 0] < low:
        return line[:0]
    if low <= line[0, 0] and line[n - 1, 0] <= high:
        return line
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
def with_vertex(line: FloatArray, v: float) -> FloatArray:
    """Return a line with a vertex at `v`, where an edge goes past it."""
    i = _count(line, v, True)
    if i == 0 or i == line.shape[0] or line[i - 1, 0] == v:
        return line
    more = np.empty((line.shape[0] + 1, 2))
    more[:i], more[i + 1 :] = line[:i], line[i:]
    more[i, 0], more[i, 1] = v, _at(line, i - 1, v)
    return more


@compiled
def image(line: FloatArray, retained: float, low: float, high: float, slope: float) -> FloatArray:
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
def cut_piece(piece: Piece, low: float, high: float) -> Piece:
    """Return the part of a piece with `low` <= v <= `high`."""
    return Piece(cut(piece.upper, low, high), cut(piece.lower, low, high))


@compiled
def mirrored(piece: Piece) -> Piece:
    """Return the mirror image of a piece, (-v, -y)."""
    return Piece(_mirrored_line(piece.lower), _mirrored_line(piece.upper))


@compiled
def _mirrored_line(line: FloatArray) -> FloatArray:
    """Return a line for -v."""
    n = line.shape[0]
    image = np.empty((n, 2))
    for i in range(n):
        image[i, 0], image[i, 1] = -line[n - 1 - i, 0], line[n - 1 - i, 1]
    return image


@compiled
def is_empty(piece: Piece) -> bool:
    """Return whether nothing is left of a piece."""
    return bool(piece.upper.shape[0] == 0)


@compiled
def spans(piece: Piece) -> bool:
    """Return whether a piece reaches over more than a single v."""
    upper = piece.upper
    return bool(upper.shape[0] > 1 and upper[0, 0] < upper[-1, 0])


@compiled
def extent(piece: Piece) -> tuple[float, float]:
    """Return the least and the greatest y of a piece."""
    return -piece.lower[:, 1].max(), piece.upper[:, 1].max()


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
def _shared(one: Piece, other: Piece, gap: float) -> tuple[float, float]:
    """Return the first range of v in which the slices of two pieces are at most `gap` apart.

    Empty (its end not above its start) if there is none.
    """
    # Taken out of the pieces once: in the loop it would cost more than the loop itself.
    upper, lower = one.upper, one.lower
    other_upper, other_lower = other.upper, other.lower
    v = max(upper[0, 0], other_upper[0, 0])
    end = min(upper[-1, 0], other_upper[-1, 0])
    low, high = math.inf, -math.inf
    if v >= end:
        return low, high
    i, j = _count(upper, v, True) - 1, _count(lower, v, True) - 1
    k, n = _count(other_upper, v, True) - 1, _count(other_lower, v, True) - 1
    while v < end:
        while upper[i + 1, 0] <= v:
            i += 1
        while lower[j + 1, 0] <= v:
            j += 1
        while other_upper[k + 1, 0] <= v:
            k += 1
        while other_lower[n + 1, 0] <= v:
            n += 1
        following = min(
            upper[i + 1, 0], lower[j + 1, 0], other_upper[k + 1, 0], other_lower[n + 1, 0]
        )
        first, last = _above(upper, i, other_lower, n, v, following, gap)
        if first <= last:
            begin, finish = _above(other_upper, k, lower, j, v, following, gap)
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
def join(pieces: Pieces, piece: Piece, gap: float) -> None:
    """Add a piece to `pieces`, as one with those whose slices are at most `gap` apart from its.

    Where they are so for some v only, the piece is cut there and its rest stays apart.
    """
    uppers, lowers = pieces.uppers, pieces.lowers
    rest_uppers, rest_lowers = [piece.upper], [piece.lower]
    while len(rest_uppers) > 0:
        piece = Piece(rest_uppers.pop(), rest_lowers.pop())
        i = 0
        while i < len(uppers):
            other = Piece(uppers[i], lowers[i])
            low, high = _shared(other, piece, gap)
            if high - low <= _SLIVER:
                i += 1
                continue
            if low > max(other.upper[0, 0], piece.upper[0, 0]) + _SLIVER:
                before = cut_piece(piece, -math.inf, low)
                rest_uppers.append(before.upper)
                rest_lowers.append(before.lower)
                piece = cut_piece(piece, low, math.inf)
            if high < min(other.upper[-1, 0], piece.upper[-1, 0]) - _SLIVER:
                after = cut_piece(piece, high, math.inf)
                rest_uppers.append(after.upper)
                rest_lowers.append(after.lower)
                piece = cut_piece(piece, -math.inf, high)
            piece = Piece(_maximum(other.upper, piece.upper), _maximum(other.lower, piece.lower))
            # Numba's list.pop(i) releases the wrong reference.
            uppers[i], lowers[i] = uppers[-1], lowers[-1]
            uppers.pop()
            lowers.pop()
            i = 0
        uppers.append(piece.upper)
        lowers.append(piece.lower)


@compiled
def union_of_intervals(intervals: list[tuple[float, float]]) -> FloatArray:
    """Return the union of intervals as disjoint ones (R, 2), in order."""
    # By insertion: they are few and nearly in order, and list.sort() takes seconds to compile.
    for i in range(1, len(intervals)):
        interval, j = intervals[i], i
        while j > 0 and intervals[j - 1][0] > interval[0]:
            intervals[j] = intervals[j - 1]
            j -= 1
        intervals[j] = interval
    union = np.empty((len(intervals), 2))
    m = 0
    for low, high in intervals:
        if m > 0 and low <= union[m - 1, 1] + TOUCHING:
            union[m - 1, 1] = max(union[m - 1, 1], high)
        else:
            union[m, 0], union[m, 1] = low, high
            m += 1
    return union[:m]


class Nearest(NamedTuple):
    """The point of a set that is nearest to another one."""

    distance: float
    """Infinite where there is none."""
    y: float
    v: float


@compiled
def nearest_on_segment(
    y: float, v: float, start: tuple[float, float], end: tuple[float, float]
) -> Nearest:
    """Return the point between `start` and `end`, both (y, v), that is nearest to (y, v)."""
    y0, v0 = start
    along_y, along_v = end[0] - y0, end[1] - v0
    length = along_y**2 + along_v**2
    share = 0.0
    if length > 0.0:
        share = ((y - y0) * along_y + (v - v0) * along_v) / length
        share = min(max(share, 0.0), 1.0)
    near_y, near_v = y0 + share * along_y, v0 + share * along_v
    return Nearest(math.hypot(y - near_y, v - near_v), near_y, near_v)


@compiled
def nearest_in_piece(y: float, v: float, piece: Piece, within: float) -> Nearest:
    """Return the point of a piece nearest to (y, v); none if all are farther than `within`."""
    upper, lower = piece.upper, piece.lower
    nearest = Nearest(math.inf, math.nan, math.nan)
    if max(upper[0, 0] - v, v - upper[-1, 0], 0.0) > within:
        return nearest
    if _is_below(y, v, upper) and _is_below(-y, v, lower):
        return Nearest(0.0, y, v)
    # Along the upper line, along the lower one, and the two ends between them.
    for line, sign in ((upper, 1.0), (lower, -1.0)):
        for k in range(line.shape[0] - 1):
            start, end = (sign * line[k, 1], line[k, 0]), (sign * line[k + 1, 1], line[k + 1, 0])
            nearest = nearer(nearest, nearest_on_segment(y, v, start, end), within)
        if sign > 0.0:
            start, end = (upper[-1, 1], upper[-1, 0]), (-lower[-1, 1], upper[-1, 0])
        else:
            start, end = (-lower[0, 1], upper[0, 0]), (upper[0, 1], upper[0, 0])
        nearest = nearer(nearest, nearest_on_segment(y, v, start, end), within)
    return nearest


@compiled
def nearer(nearest: Nearest, other: Nearest, within: float) -> Nearest:
    """Return the nearer of two, the first of equals; never one that is farther than `within`."""
    return other if other.distance <= within and other.distance < nearest.distance else nearest


@compiled
def _is_below(y: float, v: float, line: FloatArray) -> bool:
    """Return whether (v, y) lies on or under `line`."""
    for i in range(line.shape[0] - 1):
        if line[i, 0] <= v <= line[i + 1, 0]:
            if line[i, 0] == line[i + 1, 0]:
                if y <= max(line[i, 1], line[i + 1, 1]):
                    return True
            elif y <= _at(line, i, v):
                return True
    return False


@compiled
def deepest(piece: Piece, y: float, low: float, high: float) -> tuple[float, float]:
    """Return how deep inside a piece y lies at best, with `low` <= v <= `high`, and at which v.

    The depth is the distance to the nearer end of the slice at v, negative outside; -inf where the
    piece has no slice there.
    """
    upper, lower = piece.upper, piece.lower
    low, high = max(low, upper[0, 0], lower[0, 0]), min(high, upper[-1, 0], lower[-1, 0])
    if low > high:
        return -math.inf, math.nan
    best, at = -math.inf, math.nan
    i, j = _count(upper, low, False), _count(lower, low, False)
    v = low
    while True:
        depth = min(_highest(upper, v) - y, _highest(lower, v) + y)
        if depth > best:
            best, at = depth, v
        if v >= high:
            return best, at
        # Up to the next row of either line both are straight: the depth peaks where they cross.
        while i < upper.shape[0] and upper[i, 0] <= v:
            i += 1
        while j < lower.shape[0] and lower[j, 0] <= v:
            j += 1
        end = high
        if i < upper.shape[0]:
            end = min(end, upper[i, 0])
        if j < lower.shape[0]:
            end = min(end, lower[j, 0])
        above_v, below_v = _at(upper, i - 1, v) - y, _at(lower, j - 1, v) + y
        above_end, below_end = _at(upper, i - 1, end) - y, _at(lower, j - 1, end) + y
        before, after = above_v - below_v, above_end - below_end
        if before * after < 0.0:
            share = before / (before - after)
            depth = above_v + share * (above_end - above_v)
            if depth > best:
                best, at = depth, v + share * (end - v)
        v = end


@compiled
def _highest(line: FloatArray, v: float) -> float:
    """Return the height of `line` at a `v` that it has, at a jump that of its upper end."""
    begin, end = _count(line, v, False), _count(line, v, True)
    if begin == end:
        return _at(line, begin - 1, v)
    highest = float(line[begin, 1])
    for i in range(begin + 1, end):
        highest = max(highest, line[i, 1])
    return highest
