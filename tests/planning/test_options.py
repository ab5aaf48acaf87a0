"""Dataclasses of options refuse what is out of their ranges, wherever they are made."""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import pytest
from annotated_types import Ge, Gt, Interval, Le, Lt
from pydantic import TypeAdapter, ValidationError

from app.planning.options import Options


@dataclass(frozen=True)
class Example(Options):
    name: str = "anything"
    above: Annotated[float, Gt(0)] = 1.0
    at_least: Annotated[float, Ge(0)] = 1.0
    below: Annotated[float, Lt(0)] = -1.0
    at_most: Annotated[float, Le(0)] = -1.0
    between: Annotated[int, Ge(1), Le(5)] = 3
    interval: Annotated[float, Interval(ge=0, lt=1)] = 0.5
    unbounded: Annotated[float, "any finite number"] = 0.0
    perhaps: Annotated[float, Ge(0)] | None = None
    nested: list[float] = field(default_factory=list)

    def check_combination(self) -> None:
        if self.at_least > self.above + 10:
            raise ValueError("at_least is too far above")


def test_values_within_their_ranges_pass() -> None:
    Example()
    Example(at_least=0.0, at_most=0.0, between=5, interval=0.0)
    Example(name="", nested=[math.nan])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"above": 0.0}, "above must be greater than 0"),
        ({"at_least": -1e-9}, "at_least must be at least 0"),
        ({"below": 0.0}, "below must be less than 0"),
        ({"at_most": 1e-9}, "at_most must be at most 0"),
        ({"between": 0}, "between must be at least 1"),
        ({"between": 6}, "between must be at most 5"),
        ({"interval": -0.1}, "interval must be at least 0"),
        ({"interval": 1.0}, "interval must be less than 1"),
        ({"perhaps": -1.0}, "perhaps must be at least 0"),
        ({"at_least": 12.0}, "at_least is too far above"),
    ],
)
def test_a_value_out_of_its_range_is_refused_with_the_bound(
    options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        Example(**options)
    with pytest.raises(ValueError, match=f"^{message}$"):
        replace(Example(), **options)


@pytest.mark.parametrize("name", ["above", "at_most", "interval", "unbounded", "perhaps"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(name: str, value: float) -> None:
    options: dict[str, Any] = {name: value}
    with pytest.raises(ValueError, match=f"^{name} must be a finite number$"):
        Example(**options)


@pytest.mark.parametrize("options", [{"above": 0.0}, {"between": 2.5}, {"unknown": 1}])
def test_what_is_read_from_a_request_keeps_to_the_same_ranges(options: dict[str, Any]) -> None:
    adapter = TypeAdapter(Example)
    assert adapter.validate_python({"above": 2.0}) == Example(above=2.0)

    with pytest.raises(ValidationError):
        adapter.validate_python(options)


@dataclass(frozen=True, slots=True)
class Base(Options):
    given: float = 0.0
    """From above,
    over two lines."""
    changed: float = 0.0
    """From above."""
    bare: float = 0.0


@dataclass(frozen=True, slots=True)
class Derived(Base):
    changed: float = 1.0
    """Its own."""
    own: float = 0.0
    """Its own."""


def test_a_schema_describes_fields_as_the_class_that_they_come_from() -> None:
    properties = TypeAdapter(Derived).json_schema()["properties"]
    assert {name: field.get("description") for name, field in properties.items()} == {
        "given": "From above,\nover two lines.",
        "changed": "Its own.",
        "bare": None,
        "own": "Its own.",
    }
