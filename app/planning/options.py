"""Dataclasses of options whose fields carry their ranges, checked wherever they are made.

The ranges stand once, in the annotations: the service's schemas read them there too.
"""

import ast
import math
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from inspect import cleandoc, getsource
from itertools import pairwise
from textwrap import dedent
from typing import Any, get_args, get_type_hints

from annotated_types import BaseMetadata, Ge, Gt, Interval, Le, Lt


class Options:
    """Base of the dataclasses of options: their numbers lie within the annotated ranges."""

    __slots__ = ()
    __pydantic_config__ = {
        "extra": "forbid",
        "allow_inf_nan": False,
        "use_attribute_docstrings": True,
        "strict": True,
    }
    """As plain data: the domain does not import the library."""

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type, build: Callable[[type], dict[str, Any]]
    ) -> dict[str, Any]:
        """Let a dict stand for the dataclass, as JSON has it; what is in it is checked strictly."""
        return build(source) | {"strict": False}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: dict[str, Any], describe: Any
    ) -> dict[str, Any]:
        """Describe fields that are inherited, too: Pydantic reads a class's own docstrings only."""
        schema: dict[str, Any] = describe(core_schema)
        properties = describe.resolve_ref_schema(schema).get("properties", {})
        for base in cls.__mro__[1:-1]:
            for name, text in _attribute_docstrings(base).items():
                if name in properties:
                    properties[name].setdefault("description", text)
        return schema

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: one of them is not finite or out of its range, or they do not go together.
        """
        check_ranges(self)
        self.check_combination()

    def check_combination(self) -> None:
        """Check what the ranges of single values do not say; nothing by default.

        Raises:
            ValueError: the values do not go together.
        """


def check_ranges(options: object) -> None:
    """Check the numbers of a dataclass against the ranges in its annotations.

    None has no range, and options within options have been checked when they were made.

    Raises:
        ValueError: a number is not finite or out of its range.
    """
    for name, constraints in _constraints(type(options)):  # type: ignore[arg-type]
        value = getattr(options, name)
        if value is None or isinstance(value, Options):
            continue
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number")
        for constraint in constraints:
            match constraint:
                case Gt(bound) if not value > bound:
                    raise ValueError(f"{name} must be greater than {bound}")
                case Ge(bound) if not value >= bound:
                    raise ValueError(f"{name} must be at least {bound}")
                case Lt(bound) if not value < bound:
                    raise ValueError(f"{name} must be less than {bound}")
                case Le(bound) if not value <= bound:
                    raise ValueError(f"{name} must be at most {bound}")


@cache
def _attribute_docstrings(options: type) -> dict[str, str]:
    """Return what stands below each field of a class."""
    (definition,) = ast.parse(dedent(getsource(options))).body
    assert isinstance(definition, ast.ClassDef)
    return {
        field.target.id: cleandoc(below.value.value)
        for field, below in pairwise(definition.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


@cache
def _constraints(options: type) -> list[tuple[str, list[BaseMetadata]]]:
    """Return the numeric fields of a dataclass, each with its single-sided constraints."""
    hints = get_type_hints(options, include_extras=True)
    return [
        (field.name, [part for item in metadata for part in _parts(item)])
        for field in fields(options)
        if (metadata := _metadata(hints[field.name]))
    ]


def _metadata(hint: Any) -> tuple[Any, ...]:
    """Return what annotates a hint, or the member of a union that is annotated."""
    members = (hint, *get_args(hint))
    return next((m.__metadata__ for m in members if hasattr(m, "__metadata__")), ())


def _parts(item: Any) -> list[BaseMetadata]:
    return list(item) if isinstance(item, Interval) else [item]
