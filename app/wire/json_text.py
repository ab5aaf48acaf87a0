"""JSON as it comes, over the wire or out of a file: the one place where a request's text is parsed.

It is stricter than Python's own parser, which takes the last of several equal keys, and knows one
kind of number, as JSON does: a double. A whole one is an integer, however it is written.
"""

import json
from collections import Counter, deque
from collections.abc import Iterator
from math import isinf
from typing import Any

from app.wire.problems import FieldError, json_pointer

SHOWN_DIGITS = 20


class UnreadableJson(ValueError):
    """A text is not JSON; the message says why."""


class NotUtf8(UnreadableJson):
    """It is not UTF-8, in which JSON travels."""


class NotJson(UnreadableJson):
    """Its syntax is wrong."""


class NestedTooDeeply(UnreadableJson):
    """It has more arrays and objects within each other than can be read."""


class InvalidParts(ValueError):
    """Parts of a text are JSON by syntax alone.

    Args:
        errors: where they are, and why nothing can be made of them.
    """

    def __init__(self, errors: list[FieldError]) -> None:
        super().__init__("; ".join(f"{error.pointer}: {error.detail}" for error in errors))
        self.errors = errors


class _Ambiguous(dict[str, Any]):
    """An object in which a key stands twice."""

    repeated: list[str]


class _TooLarge(str):
    """The digits of a number that no double holds."""

    __slots__ = ()


def parse_json(text: bytes) -> Any:
    """Return what a JSON text says, whole numbers as `int`; NaN and infinities are let by.

    Raises:
        UnreadableJson: it is not UTF-8, not JSON, or nested too deeply.
        InvalidParts: an object has a key twice, or a number is too large for a double.
    """
    is_valid = True

    def read_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        nonlocal is_valid
        members = dict(pairs)
        if len(members) == len(pairs):
            return members
        is_valid = False
        ambiguous = _Ambiguous(members)
        times = Counter(key for key, _ in pairs)
        ambiguous.repeated = [key for key in members if times[key] > 1]
        return ambiguous

    def read_number(digits: str) -> float | _TooLarge:
        nonlocal is_valid
        number = float(digits)
        if isinf(number):
            is_valid = False
            return _TooLarge(digits)
        return int(number) if number.is_integer() else number

    try:
        parsed = json.loads(
            text.decode("utf-8-sig"),
            object_pairs_hook=read_object,
            parse_int=read_number,
            parse_float=read_number,
        )
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise NotUtf8(f"not UTF-8: byte 0x{byte:02x} at position {error.start}") from None
    except json.JSONDecodeError as error:
        reason = f"{error.msg} at line {error.lineno}, column {error.colno}"
        raise NotJson(f"not JSON: {reason if text.strip() else 'it is empty'}") from None
    except RecursionError:
        raise NestedTooDeeply("arrays and objects are nested too deeply to be read") from None
    if not is_valid:
        raise InvalidParts(list(_find_errors(parsed)))
    return parsed


def _find_errors(parsed: Any) -> Iterator[FieldError]:
    """Walk all that was parsed, without recursion: it may be nested deeply."""
    waiting: deque[tuple[tuple[str | int, ...], Any]] = deque([((), parsed)])
    while waiting:
        keys, value = waiting.popleft()
        match value:
            case _TooLarge():
                cut = f"... ({len(value)} characters)" if len(value) > SHOWN_DIGITS else ""
                detail = f"{value[:SHOWN_DIGITS]}{cut} is too large a number"
                yield FieldError(pointer=json_pointer(keys), detail=detail)
            case dict():
                for key in value.repeated if isinstance(value, _Ambiguous) else ():
                    yield FieldError(
                        pointer=json_pointer((*keys, key)), detail="the key appears more than once"
                    )
                waiting.extend(((*keys, key), member) for key, member in value.items())
            case list():
                waiting.extend(((*keys, index), item) for index, item in enumerate(value))
