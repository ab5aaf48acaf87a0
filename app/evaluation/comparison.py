"""Picking an entrant's measures out of a suite's data, and who wins against whom."""

from collections.abc import Mapping
from typing import Literal, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation.cells import percent
from app.evaluation.question import Entrant
from app.evaluation.section import Table
from app.evaluation.statistics import share_won

Unit: TypeAlias = Literal["task", "run"]
"""The column of what statistics are over."""


def rows_of(data: pd.DataFrame, entrant: Entrant, **where: float) -> pd.DataFrame:
    """Return an entrant's rows, those whose columns have the values `where`."""
    chosen = data.entrant == entrant.label
    for name, value in where.items():
        chosen &= data[name] == value
    return data[chosen]


def column(
    data: pd.DataFrame, entrant: Entrant, measure: str, **where: float
) -> NDArray[np.float64]:
    """Return a measure of an entrant's rows, (rows,)."""
    return rows_of(data, entrant, **where)[measure].to_numpy(np.float64)


def per_unit(
    data: pd.DataFrame, entrant: Entrant, measure: str, unit: Unit = "task", **where: float
) -> NDArray[np.float64]:
    """Return a measure averaged over the rows of each task or run, (units,), in their order."""
    rows = rows_of(data, entrant, **where)
    return rows.groupby(unit)[measure].mean().to_numpy(np.float64)


def wins(
    errors: Mapping[Entrant, NDArray[np.float64]], name: str, caption: str, units: str = "tasks"
) -> Table:
    """Make a table of the shares of tasks (or `units`) on which the row's entrant beats another."""
    return Table(
        name,
        f"{caption}: share of the {units} on which the row's method does better than the column's "
        "(equal within a micrometre counts for neither).",
        ("Method", *(entrant.label for entrant in errors)),
        [
            [
                first.label,
                *(
                    "" if first == second else percent(share_won(own, other))
                    for second, other in errors.items()
                ),
            ]
            for first, own in errors.items()
        ],
    )
