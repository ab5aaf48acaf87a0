"""What a suite's part of the report is made of: tables, pictures, and claims of the paper."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Table:
    """A table of finished cells."""

    name: str
    """Of its LaTeX file."""
    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure with its caption."""

    name: str
    """Of its files."""
    caption: str
    figure: Figure


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper, and what our numbers say to it."""

    statement: str
    confirmed: bool
    evidence: str


@dataclass(frozen=True, slots=True)
class Section:
    """A suite's part of the report."""

    title: str
    introduction: str
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    claims: tuple[Claim, ...] = ()
