"""Polylines and the pieces between them, held against a dense search of the same points."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.reachable.polylines import (
    Piece,
    cut,
    cut_piece,
    deepest,
    extent,
    image,
    is_empty,
    mirrored,
    nearest_in_piece,
    nearest_on_segment,
    spans,
    union_of_intervals,
)

ROUNDING = 1e-9
coordinates = st.integers(-8, 8).map(lambda number: number / 4)


@st.composite
def lines(draw: st.DrawFn) -> FloatArray:
    """Draw a polyline that covers -2 to 2, with jumps where two rows have the same v."""
    inner = draw(st.lists(coordinates, max_size=6))
    v = sorted([-2.0, *inner, 2.0])
    return np.array([(at, draw(coordinates)) for at in v])


@st.composite
def pieces(draw: st.DrawFn) -> Piece:
    """Draw a piece whose upper edge lies above its lower one."""
    upper, lower = draw(lines()), draw(lines())
    upper[:, 1] += 2.0
    lower[:, 1] += 2.0
    return Piece(upper, lower)


def height(line: FloatArray, v: float) -> float:
    """Return the greatest y of `line` at `v`; minus infinity where it has none."""
    heights = [-math.inf]
    for (v0, y0), (v1, y1) in pairwise(line):
        if v0 == v1 == v:
            heights += [y0, y1]
        elif v0 <= v <= v1 and v0 < v1:
            heights.append(y0 + (y1 - y0) * (v - v0) / (v1 - v0))
    return max(heights)


def points_on(line: FloatArray) -> FloatArray:
    """Return points (N, 2) on `line`, its vertices among them."""
    shares = np.linspace(0, 1, 60)[:, None]
    return np.concatenate([start + shares * (end - start) for start, end in pairwise(line)])


@given(lines(), coordinates, coordinates)
def test_a_part_of_a_line_is_the_line_where_it_is_kept(
    line: FloatArray, low: float, high: float
) -> None:
    low, high = sorted((low, high))
    part = cut(line, low, high)

    assert np.all((part[:, 0] >= low) & (part[:, 0] <= high))
    for v in np.linspace(low, high, 9):
        if low < high:
            assert height(part, v) == pytest.approx(height(line, v))


def test_a_part_beyond_the_ends_of_a_line_is_empty() -> None:
    line = np.array([[0.0, 1.0], [1.0, 2.0]])

    assert len(cut(line, 1.5, 2.0)) == len(cut(line, -2.0, -0.5)) == 0
    assert is_empty(cut_piece(Piece(line, line), 1.5, 2.0))
    assert not spans(cut_piece(Piece(line, line), 1.0, 2.0))


@given(
    line=lines(),
    retained=st.floats(0.2, 1),
    window=st.tuples(coordinates, coordinates),
    slope=coordinates,
)
def test_the_image_of_a_line_is_the_greatest_height_within_the_window(
    line: FloatArray, retained: float, window: tuple[float, float], slope: float
) -> None:
    low, high = sorted(window)
    result = image(line, retained, low, high, slope)
    points = points_on(line)

    assert np.all(np.diff(result[:, 0]) >= 0)
    assert result[0, 0] == pytest.approx(retained * line[0, 0] + low)
    assert result[-1, 0] == pytest.approx(retained * line[-1, 0] + high)
    # Vertices are at least 0.25 apart, and the image is narrower by `retained`.
    steepest = 100.0
    for w in np.linspace(result[0, 0], result[-1, 0], 7):
        # On a jump either of two heights is right; rounding decides which.
        margin = 1e-6
        inner, outer = (
            points[
                (w - retained * points[:, 0] >= low - by)
                & (w - retained * points[:, 0] <= high + by)
            ]
            for by in (-margin, margin)
        )
        near = [height(result, v) for v in (w - margin, w, w + margin)]
        if len(inner):
            assert max(near) >= inner[:, 1].max() + slope * w - steepest * margin
        if len(outer):
            # Between two of the points the line may be higher by what it rises on the way.
            rise = np.abs(np.diff(line[:, 1])).max() / 59
            assert min(near) <= outer[:, 1].max() + slope * w + rise + steepest * margin


@given(pieces())
def test_the_mirror_image_of_the_mirror_image_is_the_piece(piece: Piece) -> None:
    image_of_piece = mirrored(piece)

    for edge, again in zip(mirrored(image_of_piece), piece, strict=True):
        np.testing.assert_array_equal(edge, again)
    low, high = extent(piece)
    assert extent(image_of_piece) == (-high, -low)


@compiled
def union_of(intervals: FloatArray) -> FloatArray:
    return union_of_intervals([(interval[0], interval[1]) for interval in intervals])


@given(st.lists(st.tuples(coordinates, coordinates).map(sorted), min_size=1))
def test_the_union_of_intervals_is_disjoint_and_covers_what_they_cover(
    intervals: list[list[float]],
) -> None:
    union = union_of(np.array(intervals))

    assert np.all(union[:, 0] <= union[:, 1])
    assert np.all(union[1:, 0] > union[:-1, 1])
    for y in np.arange(-2, 2.01, 0.125):
        covered = any(low <= y <= high for low, high in intervals)
        assert np.any((union[:, 0] <= y) & (y <= union[:, 1])) == covered


@given(*[coordinates] * 6)
def test_no_point_of_a_segment_is_nearer_than_the_nearest(
    y: float, v: float, y0: float, v0: float, y1: float, v1: float
) -> None:
    nearest = nearest_on_segment(y, v, (y0, v0), (y1, v1))

    shares = np.linspace(0, 1, 101)
    distances = np.hypot(y - y0 - shares * (y1 - y0), v - v0 - shares * (v1 - v0))
    assert nearest.distance <= distances.min() + ROUNDING
    assert nearest.distance == pytest.approx(math.hypot(y - nearest.y, v - nearest.v))
    assert distances.min() <= nearest.distance + math.hypot(y1 - y0, v1 - v0) / 100


@given(pieces(), coordinates, coordinates)
def test_the_nearest_point_of_a_piece_lies_in_it(piece: Piece, y: float, v: float) -> None:
    nearest = nearest_in_piece(2 * y, 2 * v, piece, math.inf)

    assert nearest.distance == pytest.approx(math.hypot(2 * y - nearest.y, 2 * v - nearest.v))
    assert nearest.y <= height(piece.upper, nearest.v) + 1e-6
    assert -nearest.y <= height(piece.lower, nearest.v) + 1e-6
    edges = np.concatenate([points_on(piece.upper), points_on(piece.lower) * (1, -1)])
    distances = np.hypot(edges[:, 1] - 2 * y, edges[:, 0] - 2 * v)
    assert nearest.distance <= distances.min() + ROUNDING


def test_what_is_farther_than_asked_for_is_not_looked_for() -> None:
    line = np.array([[0.0, 1.0], [1.0, 1.0]])

    assert nearest_in_piece(3.0, 0.5, Piece(line, line), 1.0).distance == math.inf
    assert nearest_in_piece(3.0, 0.5, Piece(line, line), 2.0).distance == 2.0


@given(piece=pieces(), y=st.floats(-3, 3), ends=st.tuples(coordinates, coordinates))
def test_the_deepest_point_is_no_less_deep_than_any_other(
    piece: Piece, y: float, ends: tuple[float, float]
) -> None:
    low, high = min(ends), max(ends)
    depth, at = deepest(piece, y, low, high)

    def depth_at(v: float) -> float:
        return min(height(piece.upper, v) - y, height(piece.lower, v) + y)

    assert low <= at <= high
    assert depth == pytest.approx(depth_at(at), abs=ROUNDING)
    assert depth >= max(depth_at(v) for v in np.linspace(low, high, 200)) - ROUNDING


def test_nothing_is_deep_in_a_piece_that_is_elsewhere() -> None:
    line = np.array([[0.0, 1.0], [1.0, 1.0]])
    assert deepest(Piece(line, line), 0.0, 1.5, 2.0)[0] == -math.inf
