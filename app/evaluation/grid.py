"""A grid: a table that is said as rows and columns, each column a heading and a cell of a row."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from app.evaluation.case import SYMBOLS, Case, Unit
from app.evaluation.cells import mean_and_spread, percent, with_interval
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.question import Entrant
from app.evaluation.section import Table
from app.evaluation.statistics import interquartile_mean, interval, share_won

Row = TypeVar("Row")


class Column(NamedTuple, Generic[Row]):
    """A column of a grid."""

    heading: str
    cell: Callable[[Row], str]


def table(name: str, caption: str, rows: Iterable[Row], columns: Sequence[Column[Row]]) -> Table:
    """Make a table; `name` is of its LaTeX file."""
    return Table(
        name,
        caption,
        tuple(column.heading for column in columns),
        [tuple(column.cell(row) for column in columns) for row in rows],
    )


METHOD = Column[Case]("Method", lambda case: case.entrant.label)


def varied(name: str) -> Column[Case]:
    """Show what the suite varies: a column of the data."""
    return Column(SYMBOLS[name], lambda case: str(case.where[name]))


def of_cases(name: str, caption: str, cases: Sequence[Case], *columns: Column[Case]) -> Table:
    """Make a table of cases: the method, what the suite varies, and then `columns`."""
    return table(name, caption, cases, (METHOD, *map(varied, cases[0].where), *columns))


def spread(heading: str, measure: str, digits: int, **where: Any) -> Column[Case]:
    """Show mean ± standard deviation of a measure, of the case or of it at another place."""
    return Column(heading, lambda case: mean_and_spread(case.at(**where).values(measure), digits))


def mean(heading: str, measure: str, digits: int, **where: Any) -> Column[Case]:
    """Show the mean of a measure, of the case or of it at another place."""
    return Column(heading, lambda case: f"{case.at(**where).mean(measure):.{digits}f}")


def median(heading: str, measure: str, digits: int) -> Column[Case]:
    """Show the median of a measure."""
    return Column(heading, lambda case: f"{np.median(case.values(measure)):.{digits}f}")


def within(heading: str, measure: str, limit: float, **where: Any) -> Column[Case]:
    """Show the share of the rows whose measure is at most `limit`, of the case or elsewhere."""
    return Column(heading, lambda case: percent(case.at(**where).share_within(measure, limit)))


def share(heading: str, measure: str, digits: int) -> Column[Case]:
    """Show the share of the rows for which a measure, true or false, is true."""
    return Column(heading, lambda case: percent(case.mean(measure), digits))


def less(
    heading: str, measure: str, other: Entrant, unit: Unit = "task", digits: int = 3
) -> Column[Case]:
    """Show the mean of the paired differences to another entrant, with its interval."""

    def difference(case: Case) -> str:
        if case.entrant == other:
            return ""
        return with_interval(case.less(case.with_entrant(other), measure, unit), digits, "+")

    return Column(heading, difference)


def statistics(
    suite: str, cases: Sequence[Case], measure: str, unit: Unit = "task", digits: int = 3
) -> Table:
    """Make a table of interquartile means, and of paired differences to the paper's sampler.

    Args:
        suite: its name.
        cases: a row each.
        measure: column of the data, an error in m.
        unit: column of what the intervals are over.
        digits: behind the point.
    """

    def middle(case: Case) -> str:
        return with_interval(interval(case.per_unit(measure, unit), interquartile_mean), digits)

    return of_cases(
        f"{suite}-statistics",
        f"{measure.replace('_', ' ').capitalize()}: interquartile mean over the {unit}s, and the "
        f"mean of the paired differences, with 95 % bootstrap intervals over the {unit}s.",
        cases,
        Column("Interquartile mean (m)", middle),
        less(f"Less {PAPER_DIFFUSION.label} (m)", measure, PAPER_DIFFUSION, unit, digits),
    )


def times(suite: str, cases: Sequence[Case], what: str) -> Table:
    """Make a table of wall-clock for `what`; arguments as for `statistics`."""
    return of_cases(
        f"{suite}-time",
        f"Wall-clock for {what}: the service's compute time, and what the client waited.",
        cases,
        spread("Time (ms)", "compute_ms", 1),
        spread("Client latency (ms)", "latency_ms", 1),
    )


def wins(
    suite: str, cases: Iterable[Case], measure: str, caption: str, unit: Unit = "task"
) -> Iterator[Table]:
    """Make a table for each K of who beats whom.

    Args:
        suite: its name.
        cases: a row and a column each, those with the same K together.
        measure: column of the data, an error in m.
        caption: what is compared.
        unit: column of what is counted.
    """
    for k, group in groupby(cases, lambda case: case.where["num_candidates"]):
        rivals = list(group)
        yield table(
            f"{suite}-wins-{k}",
            f"{caption}, K = {k}: share of the {unit}s on which the row's method does better than "
            "the column's (equal within a micrometre counts for neither).",
            rivals,
            (METHOD, *(_wins_over(rival, measure, unit) for rival in rivals)),
        )


def _wins_over(rival: Case, measure: str, unit: Unit) -> Column[Case]:
    def wins_share(case: Case) -> str:
        if case.entrant == rival.entrant:
            return ""
        return percent(share_won(case.per_unit(measure, unit), rival.per_unit(measure, unit)))

    return Column(rival.entrant.label, wins_share)
