"""One parser for all JSON that comes: what it takes, and what it refuses that Python's takes."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.wire.json_text import InvalidParts, NestedTooDeeply, NotJson, NotUtf8, parse_json

values = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.integers(-(2**53), 2**53)
    # Halves of surrogate pairs too: JSON escapes them.
    | st.text(st.characters(), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)  # fmt: skip


@given(values)
def test_what_is_json_is_read_as_it_is(value: Any) -> None:
    assert parse_json(json.dumps(value).encode()) == value
    assert parse_json(json.dumps(value, ensure_ascii=True, indent=2).encode()) == value


@given(st.integers(-(2**53), 2**53), st.sampled_from(["{}", "{}.0", "{}.000", "{}e0", "{}E+0"]))
def test_a_whole_number_is_an_integer_however_it_is_written(number: int, form: str) -> None:
    parsed = parse_json(form.format(number).encode())
    assert type(parsed) is int
    assert parsed == number


@pytest.mark.parametrize(
    ("text", "number"),
    [("0.1", 0.1), ("2.5e1", 25), ("1e-400", 0), ("0." + "3" * 5000, 1 / 3), ("-0.0", 0)],
)
def test_a_number_is_the_nearest_double(text: str, number: float) -> None:
    assert parse_json(text.encode()) == number


def test_a_byte_order_mark_does_no_harm() -> None:
    assert parse_json(b'\xef\xbb\xbf{"seed": 7}') == {"seed": 7}


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (b"", NotJson, "not JSON: it is empty"),
        (b" \r\n", NotJson, "not JSON: it is empty"),
        (b'{\n "seed": }', NotJson, "not JSON: Expecting value at line 2, column 10"),
        (b"{} {}", NotJson, "not JSON: Extra data at line 1, column 4"),
        (b"seed=7", NotJson, "not JSON: Expecting value at line 1, column 1"),
        (b'{"seed": 07}', NotJson, "not JSON: "),
        (b'{"seed": "\xff"}', NotUtf8, "not UTF-8: byte 0xff at position 10"),
        ('{"seed": 7}'.encode("utf-16"), NotUtf8, "not UTF-8: byte 0xff at position 0"),
        (b"\x1f\x8b\x08\x00", NotUtf8, "not UTF-8: byte 0x8b at position 1"),
        (b"[" * 30_000, NestedTooDeeply, "nested too deeply"),
        (b"[" * 30_000 + b"]" * 30_000, NestedTooDeeply, "nested too deeply"),
        (b'{"a":' * 30_000, NestedTooDeeply, "nested too deeply"),
    ],
)
def test_a_text_that_cannot_be_read_is_told_why(
    text: bytes, error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as raised:
        parse_json(text)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("text", "pointers"),
    [
        ('{"seed": 7, "seed": 7}', ["/seed"]),
        ('{"seed": 7, "seed": 8, "seed": 9, "a": 1, "a": 2, "b": 0}', ["/seed", "/a"]),
        (r'{"seed": 7, "s\u0065ed": 7}', ["/seed"]),
        ('[{}, {"a": {"~/": 1, "~/": 1}}]', ["/1/a/~0~1"]),
        ('{"a": [[{"b": 1, "b": 1}]], "c": 1, "c": 1}', ["/c", "/a/0/0/b"]),
        (r'{"\ud800": 1, "\ud800": 1}', [r"/\ud800"]),
        ("[" * 400 + '{"a": 1, "a": 1}' + "]" * 400, ["/0" * 400 + "/a"]),
    ],
)
def test_a_key_that_appears_twice_is_pointed_at(text: str, pointers: list[str]) -> None:
    with pytest.raises(InvalidParts) as raised:
        parse_json(text.encode())
    assert [error.pointer for error in raised.value.errors] == pointers
    assert {error.detail for error in raised.value.errors} == {"the key appears more than once"}


@pytest.mark.parametrize(
    ("text", "detail"),
    [
        ("9" * 5000, "99999999999999999999... (5000 characters) is too large a number"),
        ("-1e309", "-1e309 is too large a number"),
        ("1" + "0" * 309 + ".5", "10000000000000000000... (312 characters) is too large a number"),
    ],
)
def test_a_number_beyond_all_doubles_is_pointed_at(text: str, detail: str) -> None:
    with pytest.raises(InvalidParts) as raised:
        parse_json(f'{{"system": [1, {text}]}}'.encode())
    (error,) = raised.value.errors
    assert (error.pointer, error.detail) == ("/system/1", detail)


def test_ten_thousand_equal_keys_are_refused_in_no_time() -> None:
    text = "{" + ",".join(['"":1'] * 10_000 + [f'"{n}":1' for n in range(10_000)]) + "}"
    with pytest.raises(InvalidParts) as raised:
        parse_json(text.encode())
    assert [error.pointer for error in raised.value.errors] == ["/"]
