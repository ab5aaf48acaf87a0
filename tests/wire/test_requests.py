"""Every field of a request takes the JSON types that its schema names, and no others."""

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from app.planning.plant.machines import MACHINES
from app.wire.field_errors import field_errors
from app.wire.json_text import InvalidParts, parse_json
from app.wire.requests import MultistepPlanRequest, PlanRequest

Request = type[PlanRequest] | type[MultistepPlanRequest]
GOOD: dict[Request, dict[str, Any]] = {
    PlanRequest: {"initial_state": [0.0, 0.0], "target_state": [0.2, 0.0], "method": "cem"},
    MultistepPlanRequest: {"initial_state": [0.0, 0.0], "targets": [[0.2, 0.0]], "method": "cem"},
}
JSON_TYPES: dict[str, st.SearchStrategy[Any]] = {
    "null": st.none(),
    "boolean": st.booleans(),
    "integer": st.integers(-1000, 1000),
    "number": st.floats(-1000, 1000).filter(lambda number: not number.is_integer()),
    "string": st.sampled_from(["", "1", "0.9", "true", "no", "None"]) | st.text(max_size=8),
    "array": st.lists(st.integers(0, 3), max_size=3),
    "object": st.dictionaries(st.text(max_size=8), st.integers(0, 3), max_size=2),
}


class Place(NamedTuple):
    """Where a value of a request stands."""

    request: Request
    pointer: str
    types: set[str]
    """That the schema allows there."""
    is_tag: bool
    """Whether the value is the name of one of several objects."""
    body: Callable[[Any], Any]
    """Return a request that has a value there, and is good besides."""

    def __repr__(self) -> str:
        return f"{self.request.__name__} {self.pointer}"


def all_places() -> Iterator[Place]:
    for request, good in GOOD.items():
        schema = request.model_json_schema()
        yield from places(request, schema, schema["$defs"], "", lambda value: value, good)


def places(
    request: Request,
    schema: Mapping[str, Any],
    definitions: Mapping[str, Any],
    pointer: str,
    body: Callable[[Any], Any],
    good: dict[str, Any] | None = None,
) -> Iterator[Place]:
    """Walk a schema; `good` has what an object there needs."""
    members = list(alternatives(schema, definitions))
    types = {member["type"] for member in members}
    yield Place(request, pointer, types, any("const" in member for member in members), body)
    for member in members:
        for key, part, enclose in parts(member, good):
            yield from places(
                request,
                part,
                definitions,
                f"{pointer}/{key}",
                lambda value, enclose=enclose: body(enclose(value)),  # type: ignore[misc]
            )


def parts(
    schema: Mapping[str, Any], good: dict[str, Any] | None
) -> Iterator[tuple[str | int, Mapping[str, Any], Callable[[Any], Any]]]:
    """Walk one level: a key, its schema, and how to build what holds a value there."""
    properties = schema.get("properties", {})
    tag = {"name": properties["name"]["const"]} if "name" in properties else {}
    # Friction by direction and limits are their own way of saying a number, of two.
    two = {"forward": 0.5, "backward": 0.5, "lower": -1, "upper": 2}
    needed = {key: two[key] for key in schema.get("required", []) if key in two}
    for key, part in properties.items():
        # Plants that may be the true one are given, or drawn.
        is_drawn = "num_motions" in properties and key != "systems"
        drawn: dict[str, Any] = {"relative": {}} if is_drawn else {}
        yield key, part, partial(with_member, good or tag | needed | drawn, key)
    if "items" in schema:
        yield 0, schema["items"], lambda value: [value]
    for index, part in enumerate(schema.get("prefixItems", [])):
        yield index, part, partial(with_item, [0.0] * len(schema["prefixItems"]), index)


def with_member(members: dict[str, Any], key: str, value: Any) -> dict[str, Any]:
    return members | {key: value}


def with_item(items: list[Any], index: int, value: Any) -> list[Any]:
    return [*items[:index], value, *items[index + 1 :]]


def alternatives(
    schema: Mapping[str, Any], definitions: Mapping[str, Any]
) -> Iterator[Mapping[str, Any]]:
    """Resolve references and unions."""
    if "$ref" in schema:
        yield from alternatives(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    elif options := schema.get("anyOf", schema.get("oneOf")):
        for option in options:
            yield from alternatives(option, definitions)
    else:
        yield schema


PLACES = list(all_places())


def read(request: Request, text: str) -> PlanRequest | MultistepPlanRequest:
    return request.model_validate(parse_json(text.encode()))


def refused(place: Place, text: str) -> list[str]:
    """Return the pointers at what is wrong with a request."""
    with pytest.raises(ValidationError) as raised:
        read(place.request, text)
    return [error.pointer for error in field_errors(raised.value.errors(), json.loads(text))]


def test_the_schemas_were_walked_to_their_ends() -> None:
    pointers = {place.pointer for place in PLACES}
    assert {
        "",
        "/targets/0/1",
        "/include/0",
        "/system/velocity_threshold",
        "/system/coulomb_friction/backward",
        "/system/control_limit/lower",
        "/pending_controls/0",
        "/refine/repair",
        "/uncertainty/relative/bias",
        "/uncertainty/systems/0/time_step",
        "/uncertainty/risk/cvar",
        "/method/prior/num_segments",
        "/initial/method/smoothing_window",
    } <= pointers
    assert len(PLACES) > 100


@given(st.sampled_from(PLACES), st.data())
@settings(max_examples=400)
def test_another_json_type_than_the_schemas_is_refused(place: Place, data: st.DataObject) -> None:
    wrong = JSON_TYPES.keys() - place.types - ({"integer"} if "number" in place.types else set())
    value = data.draw(st.sampled_from(sorted(wrong)).flatmap(JSON_TYPES.__getitem__))
    at_fault = place.pointer.rpartition("/")[0] if place.is_tag else place.pointer
    assert at_fault in refused(place, json.dumps(place.body(value)))


INTEGERS = [place for place in PLACES if "integer" in place.types]


@pytest.mark.parametrize("place", INTEGERS, ids=repr)
def test_a_whole_number_is_an_integer_however_it_is_written(place: Place) -> None:
    text = json.dumps(place.body("here"))
    expected = read(place.request, text.replace('"here"', "3"))
    for three in ("3.0", "30e-1", "0.3E1"):
        assert repr(read(place.request, text.replace('"here"', three))) == repr(expected)


def test_integers_stand_for_numbers() -> None:
    for place in PLACES:
        if "number" in place.types:
            try:
                read(place.request, json.dumps(place.body(1)))
            except ValidationError as error:  # too large, or not with the others
                kinds = {part["type"] for part in error.errors()}
                assert kinds <= {"value_error", "less_than_equal", "less_than"}


def test_a_key_twice_is_refused_at_any_depth() -> None:
    for place in PLACES:
        text = json.dumps(place.body("here")).replace('"here"', '{"a": 1, "a": 1}')
        with pytest.raises(InvalidParts) as raised:
            read(place.request, text)
        assert [error.pointer for error in raised.value.errors] == [f"{place.pointer}/a"]


@pytest.mark.parametrize(
    ("fields", "pointer"),
    [
        ({"seed": True}, ("seed",)),
        ({"initial_state": ("0", 0)}, ("initial_state", 0)),
        ({"system": {"time_step": "0.9"}}, ("system", "time_step")),
        ({"pending_controls": (0, True)}, ("pending_controls", 1)),
        ({"refine": {"repair": "no"}}, ("refine", "repair")),
        ({"method": {"name": "cem", "iterations": 2.0}}, ("method", "cem", "iterations")),
    ],
)
def test_values_in_python_are_checked_as_strictly(
    fields: dict[str, Any], pointer: tuple[str, ...]
) -> None:
    with pytest.raises(ValidationError) as raised:
        PlanRequest(**GOOD[PlanRequest] | fields)
    assert raised.value.errors()[0]["loc"] == pointer


@pytest.mark.parametrize("name", MACHINES)
def test_the_name_of_a_machine_stands_for_its_plant(name: str) -> None:
    request = PlanRequest(**GOOD[PlanRequest] | {"system": name})
    assert request.system == MACHINES[name].system
    assert PlanRequest.model_validate(request.model_dump()) == request


def test_lists_and_tuples_stand_for_arrays() -> None:
    lists: dict[str, Any] = {"initial_state": [0, 0], "targets": [[1, 0]], "include": ["states"]}
    tuples: dict[str, Any] = {"initial_state": (0, 0), "targets": ((1, 0),), "include": ("states",)}
    assert MultistepPlanRequest(**lists) == MultistepPlanRequest(**tuples)
