"""JSON in parts: the same values, whatever their shape and number."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.serving.json_parts import NUMBERS_AT_ONCE, PART_BYTES, json_parts

LONGEST_NUMBER = len("-2.2250738585072014e-308,")


def read(value: Any) -> Any:
    return json.loads(b"".join(json_parts(value)))


@given(arrays(np.float64, (3, 4), elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_every_number_is_read_as_it_was_and_written_as_short_as_can_be(array: Any) -> None:
    (text,) = json_parts(array)
    assert json.loads(text) == array.tolist()
    for written, number in zip(text.translate(None, b"[]").split(b","), array.flat, strict=True):
        digits, shortest = (
            str(each).partition("e")[0].replace(".", "").strip("-0")
            for each in (written.decode(), repr(float(number)))
        )
        assert len(digits) <= len(shortest)


@pytest.mark.parametrize(
    "shape",
    [
        (NUMBERS_AT_ONCE,),
        (NUMBERS_AT_ONCE + 1,),
        (5 * NUMBERS_AT_ONCE - 1,),
        (301, 64),
        (2, NUMBERS_AT_ONCE + 1),
        (100, 82, 2),
        (0, 7),
        (3, 0),
    ],
)
def test_large_arrays_are_written_in_slices_of_the_same_values(shape: tuple[int, ...]) -> None:
    array = np.random.default_rng(0).standard_normal(shape)
    assert read({"a": array, "b": [array, array]}) == {
        "a": array.tolist(),
        "b": [array.tolist()] * 2,
    }


def test_an_array_of_any_memory_layout_is_written() -> None:
    array = np.random.default_rng(0).standard_normal((200, 99))
    assert read(array.T) == array.T.tolist()
    assert read(array[:3, ::2]) == array[:3, ::2].tolist()


@dataclass(frozen=True, slots=True)
class Pair:
    left: float
    right: float


def test_what_is_none_is_left_out_and_all_else_is_there() -> None:
    value = {
        "none": None,
        "text": 'a "ü"',
        "whole": 2**53 - 1,
        "yes": True,
        "numpy": np.float64(0.1),
        "pair": Pair(0.1, 1e-3),
        "within": {"none": None, "left": 1, "nothing": {"none": None}},
        "list": [{"none": None}, {"some": 0.5}],
        "empty": [],
    }
    assert read(value) == {
        "text": 'a "ü"',
        "whole": 2**53 - 1,
        "yes": True,
        "numpy": 0.1,
        "pair": {"left": 0.1, "right": 1e-3},
        "within": {"left": 1, "nothing": {}},
        "list": [{}, {"some": 0.5}],
        "empty": [],
    }


def test_all_parts_but_the_last_are_full_and_none_takes_long_to_write() -> None:
    array = np.random.default_rng(0).standard_normal((1000, 81))
    *full, last = json_parts({"a": array})
    assert len(full) > 10
    assert all(len(part) >= PART_BYTES for part in full)
    longest = PART_BYTES + NUMBERS_AT_ONCE * LONGEST_NUMBER
    assert max(map(len, full)) < longest
    assert len(last) < PART_BYTES
    assert list(json_parts({"a": array[:2]})) == [json_text(array[:2])]


def json_text(array: Any) -> bytes:
    return json.dumps({"a": array.tolist()}, separators=(",", ":")).encode()
