"""Fields at fault: what a schema's check found, as JSON pointers with a reason in plain words."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple, TypeAlias, get_args, get_type_hints

from app.planning.plant.system import ByDirection, ControlLimits, System
from app.planning.refining.refinement import Refinement
from app.wire.problems import FieldError, json_pointer
from app.wire.uncertainty import CVaR

Keys: TypeAlias = tuple[int | str, ...]

WRONG_TYPES = {
    "float_type": "a number",
    "dataclass_type": "an object",
    "model_type": "an object",
    "literal_error": "one of some names",
}
"""Errors of a union's member that does not take such a value at all, and what it takes."""
OBJECTS = {
    System.__name__: "an object, or the name of a machine",
    Refinement.__name__: "an object, true or false",
    **{
        kind.__name__: f"an object with {' and '.join(field.name for field in fields(kind))}"
        for kind in (ByDirection, ControlLimits)
    },
    CVaR.__name__: "an object with cvar",
}
"""What stands for a dataclass, where that is not just an object."""
UNIONS = {
    name
    for name, hint in get_type_hints(System).items()
    if any(is_dataclass(member) for member in get_args(hint))
}
"""Fields that may be a number or an object."""
IN_WORDS = {
    "model_type": "must be an object",
    "model_attributes_type": "must be an object",
    "dict_type": "must be an object",
    "list_type": "must be an array",
    "tuple_type": "must be an array",
}
"""Errors that Pydantic tells in Python's words."""


class _Fault(NamedTuple):
    """An error that Pydantic found."""

    item: Mapping[str, Any]
    keys: Keys
    """To the value at fault, from the outside in."""
    members: dict[Keys, int | str]
    """The members of unions on the way, by the keys to the union."""

    @property
    def is_wrong_type(self) -> bool:
        """Whether it says that the innermost union's member does not take the value."""
        return self.item["type"] in WRONG_TYPES and self.keys in self.members


def field_errors(errors: Iterable[Mapping[str, Any]], body: Any) -> list[FieldError]:
    """Return where a request is at fault, and how.

    Of a union, Pydantic tells what every member finds wrong. Only those count that take a value of
    such a type; if there are none, one error says what all of them take.

    Args:
        errors: what Pydantic found, with locations within `body`.
        body: the request as it came, parsed.
    """
    faults = [_fault(item, body) for item in errors]
    refusing: defaultdict[Keys, list[_Fault]] = defaultdict(list)
    taking: defaultdict[Keys, set[int | str]] = defaultdict(set)
    for fault in faults:
        if fault.is_wrong_type:
            refusing[fault.keys].append(fault)
        for union, member in fault.members.items():
            if not (fault.is_wrong_type and union == fault.keys):
                taking[union].add(member)
    found = []
    for fault in faults:
        if any(taking[union] and m not in taking[union] for union, m in fault.members.items()):
            continue
        detail = _detail(fault.item)
        if fault.is_wrong_type:
            others = refusing[fault.keys]
            if fault is not others[0]:
                continue
            detail = f"must be {', or '.join(_taken(other.item) for other in others)}"
        found.append(FieldError(pointer=json_pointer(fault.keys), detail=detail))
    return found


def _fault(item: Mapping[str, Any], body: Any) -> _Fault:
    """Tell the keys of an error's location within `body` from the names of unions' members.

    Pydantic puts the name of a union's member among the keys. After one of `UNIONS` it always does;
    elsewhere a name is a key that the body lacks, as it lacks a missing field, which stands last.
    """
    location = item["loc"]
    keys: list[int | str] = []
    members: dict[Keys, int | str] = {}
    value = body
    for index, key in enumerate(location):
        is_missing = item["type"] == "missing" and index == len(location) - 1
        if keys and keys[-1] in UNIONS and tuple(keys) not in members:
            members[tuple(keys)] = key
            continue
        if isinstance(value, dict) and (key in value or is_missing):
            value = value.get(key)
        elif isinstance(value, list) and isinstance(key, int):
            value = value[key] if key < len(value) else None
        else:
            members[tuple(keys)] = key
            continue
        keys.append(key)
    return _Fault(item, tuple(keys), members)


def _detail(item: Mapping[str, Any]) -> str:
    """Return what is wrong with one field; a number that is not finite is called by its name."""
    value = item.get("input")
    if isinstance(value, float) and not math.isfinite(value):
        name = "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return f"{name} is not a finite number"
    match item["type"]:
        case "union_tag_invalid":
            context = item["ctx"]
            tag, known = context["tag"], context["expected_tags"]
            return f"no {_tagged(item)} {tag!r}; there are: {known}"
        case "union_tag_not_found":
            return f"the {_tagged(item)}'s {item['ctx']['discriminator'].strip(chr(39))} is missing"
        case "model_attributes_type" if item["loc"]:
            return f"must be an object, or the name of a {_tagged(item)}"
        case "dataclass_type":
            return f"must be {_taken(item)}"
    return IN_WORDS.get(item["type"], str(item["msg"]).removeprefix("Value error, "))


def _tagged(item: Mapping[str, Any]) -> str:
    """Return what has a name, or a type, by which it is known: the field is called after it."""
    return str(item["loc"][-1]) if item["loc"] else "message"


def _taken(item: Mapping[str, Any]) -> str:
    """Return what is taken where a value of another type stands."""
    context = item.get("ctx", {})
    taken = str(context.get("expected", WRONG_TYPES[item["type"]]))
    return OBJECTS.get(context.get("class_name", ""), taken)
