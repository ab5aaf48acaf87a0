"""What a suite's part of the report is made of: text, tables, a picture, claims of the paper."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import pandas as pd
from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Table:
    """A table of finished cells."""

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    part: str = ""
    """Follows the suite's name in that of its LaTeX file; the main table has none."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The suite's figure with its caption."""

    caption: str
    figure: Figure


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper, and what our numbers say to it."""

    statement: str
    confirmed: bool
    evidence: str


Part: TypeAlias = str | Table | Picture | Claim
Parts: TypeAlias = Iterator[Part]
Kind = TypeVar("Kind", bound=Part)


@dataclass(frozen=True, slots=True)
class Section:
    """A suite's part of the report: at most one picture, and of all else any number."""

    name: str
    """Of the suite, and of its files."""
    title: str
    parts: Sequence[Part]
    data: pd.DataFrame

    def all(self, kind: type[Kind]) -> list[Kind]:
        """Return the parts of a kind, in their order."""
        return [part for part in self.parts if isinstance(part, kind)]
