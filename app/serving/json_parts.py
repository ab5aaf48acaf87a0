"""An answer as JSON text, in parts: no step of it keeps other threads from Python for long.

numpy's arrays go straight into text, every number with the fewest digits that say it exactly.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import orjson

PART_BYTES = 1 << 16
"""No part but the last is shorter."""
NUMBERS_AT_ONCE = 1 << 12
"""Written in about a quarter of a millisecond, for which the interpreter is locked."""
PLAIN = {float, int, str, bool}
PAUSE_SECONDS = 5e-5
"""Between parts: long enough for others to get the interpreter's lock, and short beside a part."""


def json_parts(value: Any) -> Iterator[bytes]:
    """Write `value` as JSON; what is None in an object is left out.

    Args:
        value: of dicts, lists, arrays, dataclasses and what JSON knows.

    Yields:
        The text in parts of `PART_BYTES` and a little more; the last one is shorter.
    """
    try:
        yield _dump(_small(value, [NUMBERS_AT_ONCE]))
        return
    except _TooLong:
        pass
    text = bytearray()
    for piece in _pieces(value):
        text += piece
        if len(text) >= PART_BYTES:
            yield bytes(text)
            text.clear()
    yield bytes(text)


class _TooLong(Exception):
    """A value holds more numbers than are written at once."""


def _small(value: Any, left: list[int]) -> Any:
    """Return `value` as it is written: no None in an object, and arrays in one piece.

    Args:
        value: as for `json_parts`.
        left: how many numbers its arrays may still hold.

    Raises:
        _TooLong: they hold more.
    """
    kind = type(value)
    if kind is dict:
        return {
            name: item if type(item) in PLAIN else _small(item, left)
            for name, item in value.items()
            if item is not None
        }
    if kind is list:
        return [_small(item, left) for item in value]
    if kind is np.ndarray:
        left[0] -= value.size
        if left[0] < 0:
            raise _TooLong
        return np.ascontiguousarray(value)
    return value


def _pieces(value: Any) -> Iterator[bytes]:
    if isinstance(value, dict):
        opening = b"{"
        for name, item in value.items():
            if item is not None:
                yield opening + orjson.dumps(name) + b":"
                yield from _pieces(item)
                opening = b","
        yield b"{}" if opening == b"{" else b"}"
    elif isinstance(value, list):
        opening = b"["
        for item in value:
            yield opening
            yield from _pieces(item)
            opening = b","
        yield b"[]" if opening == b"[" else b"]"
    elif isinstance(value, np.ndarray) and value.size > NUMBERS_AT_ONCE:
        rows = max(1, NUMBERS_AT_ONCE * len(value) // value.size)
        opening = b"["
        for first in range(0, len(value), rows):
            yield opening + _dump(value[first : first + rows])[1:-1]
            opening = b","
        yield b"]"
    else:
        yield _dump(value)


def _dump(value: Any) -> bytes:
    if isinstance(value, np.ndarray):
        value = np.ascontiguousarray(value)
    return orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY)
