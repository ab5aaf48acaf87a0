"""A grid: a table that is said as rows and columns, each column a heading and a cell of a row."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from app.evaluation.case import SYMBOLS, Case
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.question import Entrant
from app.evaluation.statistics import interquartile_mean, interval, percent, share_won
from app.evaluation.suite import Table

Row = TypeVar("Row")


class Column(NamedTuple, Generic[Row]):
    """A column of a grid."""

    heading: str
    cell: Callable[[Row], str]


def table(
    caption: str, rows: Iterable[Row], columns: Sequence[Column[Row]], part: str = ""
) -> Table:
    """Make a table; `part` tells its file from that of the suite's main table."""
    cells = [tuple(column.cell(row) for column in columns) for row in rows]
    return Table(caption, tuple(column.heading for column in columns), cells, part)


METHOD = Column[Case]("Method", lambda case: case.entrant.label)


def varied(name: str) -> Column[Case]:
    """Show what the suite varies: a column of the data."""
    return Column(SYMBOLS[name], lambda case: str(case.where[name]))


def of_cases(caption: str, cases: Sequence[Case], *columns: Column[Case], part: str = "") -> Table:
    """Make a table of cases: the method, what the suite varies, and then `columns`."""
    return table(caption, cases, (METHOD, *map(varied, cases[0].where), *columns), part)


def elsewhere(heading: str, cell: Callable[[Case], str], **where: Any) -> Column[Case]:
    """Show the cell of a case at another place, nothing where it has no rows there."""

    def shown(case: Case) -> str:
        there = case.at(**where)
        return cell(there) if len(there.rows) else ""

    return Column(heading, shown)


def spread(heading: str, measure: str, digits: int, **where: Any) -> Column[Case]:
    """Show mean ± standard deviation of a measure, of the case or of it at another place."""

    def cell(case: Case) -> str:
        values = case.values(measure)
        return f"{values.mean():.{digits}f} ± {values.std():.{digits}f}"

    return elsewhere(heading, cell, **where)


def mean(heading: str, measure: str, digits: int, **where: Any) -> Column[Case]:
    """Show the mean of a measure, of the case or of it at another place."""
    return elsewhere(heading, lambda case: f"{case.mean(measure):.{digits}f}", **where)


def median(heading: str, measure: str, digits: int, **where: Any) -> Column[Case]:
    """Show the median of a measure, of the case or of it at another place."""
    return elsewhere(heading, lambda case: f"{np.median(case.values(measure)):.{digits}f}", **where)


def within(heading: str, measure: str, limit: float, **where: Any) -> Column[Case]:
    """Show the share of the rows whose measure is at most `limit`, of the case or elsewhere."""
    return elsewhere(heading, lambda case: percent(case.share_within(measure, limit)), **where)


def share(heading: str, measure: str, digits: int, **where: Any) -> Column[Case]:
    """Show the share of the rows for which a measure, true or false, is true; or elsewhere."""
    return elsewhere(heading, lambda case: percent(case.mean(measure), digits), **where)


def others(heading: str, other: Entrant, cell: Callable[[Case], str]) -> Column[Case]:
    """Show how a case stands to that of another entrant, for which itself the cell is empty."""
    return Column(heading, lambda case: "" if case.entrant == other else cell(case))


def less(heading: str, measure: str, other: Entrant, digits: int = 3) -> Column[Case]:
    """Show the mean of the paired differences to another entrant, with its interval."""
    return others(heading, other, lambda case: case.less(other, measure).shown(digits, "+"))


def statistics(cases: Sequence[Case], measure: str, digits: int = 3) -> Table:
    """Make a table of interquartile means, and of paired differences to the paper's sampler.

    Args:
        cases: a row each.
        measure: column of the data, an error in m.
        digits: behind the point.
    """
    unit = cases[0].unit

    def middle(case: Case) -> str:
        return interval(case.per_unit(measure), interquartile_mean).shown(digits)

    return of_cases(
        f"{measure.replace('_', ' ').capitalize()}: interquartile mean over the {unit}s, and the "
        f"mean of the paired differences, with 95 % bootstrap intervals over the {unit}s.",
        cases,
        Column("Interquartile mean (m)", middle),
        less(f"Less {PAPER_DIFFUSION.label} (m)", measure, PAPER_DIFFUSION, digits),
        part="statistics",
    )


def times(cases: Sequence[Case], what: str) -> Table:
    """Make a table of wall-clock for `what`, a row a case."""
    return of_cases(
        f"Wall-clock for {what}: the service's compute time, and what the client waited.",
        cases,
        spread("Time (ms)", "compute_ms", 1),
        spread("Client latency (ms)", "latency_ms", 1),
        part="time",
    )


def wins(cases: Iterable[Case], measure: str, caption: str) -> Iterator[Table]:
    """Make a table for each K of who beats whom.

    Args:
        cases: a row and a column each, those with the same K together.
        measure: column of the data, an error in m.
        caption: what is compared.
    """

    def over(rival: Case) -> Column[Case]:
        def won(case: Case) -> str:
            return percent(share_won(case.per_unit(measure), rival.per_unit(measure)))

        return others(rival.entrant.label, rival.entrant, won)

    for k, group in groupby(cases, lambda case: case.where["num_candidates"]):
        rivals = list(group)
        yield table(
            f"{caption}, K = {k}: share of the {rivals[0].unit}s on which the row's method does "
            "better than the column's (equal within a micrometre counts for neither).",
            rivals,
            (METHOD, *map(over, rivals)),
            part=f"wins-{k}",
        )
