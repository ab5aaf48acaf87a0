"""Fields at fault: what a schema's check found, as JSON pointers with a reason in plain words."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from app.wire.problems import FieldError, json_pointer


def field_errors(errors: Iterable[Mapping[str, Any]], body: Any) -> list[FieldError]:
    """Return where a request is at fault, and how.

    Args:
        errors: what Pydantic found, with locations within `body`.
        body: the request as it came, parsed.
    """
    return [
        FieldError(
            pointer=_pointer(item["loc"], body, item["type"] == "missing"), detail=_detail(item)
        )
        for item in errors
    ]


def _pointer(location: tuple[int | str, ...], body: Any, is_missing: bool) -> str:
    """Return the JSON pointer (RFC 6901) of a validation error's location within `body`.

    Pydantic puts the tag of a union's member among the keys; a tag is a key that the body lacks,
    as it lacks a missing field, which stands last.
    """
    keys: list[int | str] = []
    value = body
    for index, key in enumerate(location):
        is_field = is_missing and index == len(location) - 1
        if isinstance(value, dict):
            if key not in value and not is_field:
                continue
            value = value.get(key)
        elif isinstance(value, list) and isinstance(key, int) and key < len(value):
            value = value[key]
        elif not isinstance(value, list):
            continue
        keys.append(key)
    return json_pointer(keys)


def _detail(item: Mapping[str, Any]) -> str:
    """Return what is wrong with one field; a number that is not finite is called by its name."""
    value = item.get("input")
    if isinstance(value, float) and not math.isfinite(value):
        name = "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return f"{name} is not a finite number"
    match item["type"]:
        case "union_tag_invalid":
            context = item["ctx"]
            return f"no method {context['tag']!r}; there are: {context['expected_tags']}"
        case "union_tag_not_found":
            return "the method's name is missing"
        case "model_attributes_type" | "model_type" | "dataclass_type":
            return "must be an object"
        case "list_type" | "tuple_type":
            return "must be an array"
    return str(item["msg"]).removeprefix("Value error, ")
