import math
from dataclasses import dataclass, field
from typing import Annotated

import pytest
from annotated_types import Ge, Gt, Interval, Le, Lt

from app.planning.options import check_ranges


@dataclass(frozen=True)
class Options:
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


def test_values_within_their_ranges_pass() -> None:
    check_ranges(Options())
    check_ranges(Options(at_least=0.0, at_most=0.0, between=5, interval=0.0))
    check_ranges(Options(name="", nested=[math.nan]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (Options(above=0.0), "above must be greater than 0"),
        (Options(at_least=-1e-9), "at_least must be at least 0"),
        (Options(below=0.0), "below must be less than 0"),
        (Options(at_most=1e-9), "at_most must be at most 0"),
        (Options(between=0), "between must be at least 1"),
        (Options(between=6), "between must be at most 5"),
        (Options(interval=-0.1), "interval must be at least 0"),
        (Options(interval=1.0), "interval must be less than 1"),
        (Options(perhaps=-1.0), "perhaps must be at least 0"),
    ],
)
def test_a_value_out_of_its_range_is_refused_with_the_bound(options: Options, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        check_ranges(options)


@pytest.mark.parametrize("name", ["above", "at_most", "interval", "unbounded", "perhaps"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name} must be a finite number$"):
        check_ranges(Options(**{name: value}))  # type: ignore[arg-type]
