"""A case of a suite's data: an entrant's rows where what the suite varies has certain values."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation.question import Entrant
from app.evaluation.statistics import Interval, interval

SYMBOLS = {
    "num_candidates": "K",
    "static_friction": "f_s",
    "refined_by": "Refined by",
    "machine": "Machine",
    "off_by": "off by",
    "circumstances": "disturbed by",
    "horizon": "H",
}
"""What tables call that which suites vary."""


@dataclass(frozen=True)
class Case:
    """An entrant's rows where columns of the data have the values of `where`."""

    data: pd.DataFrame
    """Of the suite."""
    entrant: Entrant
    where: dict[str, Any]

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows, in the order of the questions."""
        chosen = self.data.entrant == self.entrant.label
        for name, value in self.where.items():
            chosen &= self.data[name] == value
        return self.data[chosen]

    @property
    def place(self) -> str:
        """What distinguishes the case from the entrant's others, as in "K = 16"."""
        return ", ".join(f"{SYMBOLS[name]} = {value}" for name, value in self.where.items())

    @property
    def unit(self) -> str:
        """What statistics are over: the tasks, or the runs where all are of one task."""
        return "task" if self.data.task.nunique() > 1 else "run"

    def values(self, measure: str) -> NDArray[np.float64]:
        """Return a measure, a column of the data: (rows,)."""
        return self.rows[measure].to_numpy(np.float64)

    def mean(self, measure: str) -> float:
        """Return the mean of a measure over the rows."""
        return float(self.values(measure).mean())

    def share_within(self, measure: str, limit: float) -> float:
        """Return the share of the rows whose measure is at most `limit`."""
        return float(np.mean(self.values(measure) <= limit))

    def per_unit(self, measure: str) -> NDArray[np.float64]:
        """Return a measure averaged over the rows of each task or run, (units,), in their order."""
        return self.rows.groupby(self.unit)[measure].mean().to_numpy(np.float64)

    def less(self, other: "Case | Entrant", measure: str) -> Interval:
        """Return the mean of the paired differences to a case, or to an entrant's at this place."""
        case = other if isinstance(other, Case) else self.with_entrant(other)
        return interval(self.per_unit(measure) - case.per_unit(measure))

    def at(self, **where: Any) -> "Case":
        """Return the entrant's case where more columns, or others, have certain values."""
        return replace(self, where=self.where | where)

    def with_entrant(self, entrant: Entrant) -> "Case":
        """Return another entrant's case at the same place."""
        return replace(self, entrant=entrant)


def taking_part(data: pd.DataFrame, entrants: Iterable[Entrant]) -> list[Entrant]:
    """Return those of the entrants that have rows in a suite's data."""
    present = set(data.entrant)
    return [entrant for entrant in entrants if entrant.label in present]


def cases_of(
    data: pd.DataFrame, entrants: Iterable[Entrant], **varied: Sequence[Any]
) -> list[Case]:
    """Return every entrant's case at all values of what is varied, the entrants innermost."""
    return [
        Case(data, entrant, dict(zip(varied, values, strict=True)))
        for *values, entrant in product(*varied.values(), entrants)
    ]
