"""Tables that several suites make: statistics of a measure, and wall-clock."""

from collections.abc import Sequence
from itertools import product

import pandas as pd

from app.evaluation.cells import mean_and_spread, with_interval
from app.evaluation.comparison import Unit, column, per_unit
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.question import Entrant
from app.evaluation.section import Table
from app.evaluation.statistics import interquartile_mean, interval, paired_difference

HEADINGS = {"num_candidates": "K", "static_friction": "f_s"}
"""Of what suites vary."""


def statistics_table(
    data: pd.DataFrame,
    name: str,
    measure: str,
    entrants: Sequence[Entrant],
    varied: str,
    values: Sequence[float],
    unit: Unit = "task",
    digits: int = 3,
) -> Table:
    """Make a table of interquartile means, and of paired differences to the paper's sampler.

    Args:
        data: of the suite.
        name: of the suite.
        measure: column of `data`, an error in m.
        entrants: a row each for every value.
        varied: column of `data` that the suite varies.
        values: of that column.
        unit: column of what the intervals are over.
        digits: behind the point.
    """
    rows = []
    for value, entrant in product(values, entrants):
        own, reference = (
            per_unit(data, of, measure, unit, **{varied: value})
            for of in (entrant, PAPER_DIFFUSION)
        )
        rows.append(
            (
                entrant.label,
                str(value),
                with_interval(interval(own, interquartile_mean), digits),
                "" if entrant == PAPER_DIFFUSION
                else with_interval(paired_difference(own, reference), digits, "+"),
            )
        )  # fmt: skip
    return Table(
        f"{name}-statistics",
        f"{measure.replace('_', ' ').capitalize()}: interquartile mean over the {unit}s, and the "
        f"mean of the paired differences, with 95 % bootstrap intervals over the {unit}s.",
        ("Method", HEADINGS[varied], "Interquartile mean (m)", f"Less {PAPER_DIFFUSION.label} (m)"),
        rows,
    )


def times_table(
    data: pd.DataFrame,
    name: str,
    what: str,
    entrants: Sequence[Entrant],
    varied: str,
    values: Sequence[float],
) -> Table:
    """Make a table of wall-clock for `what`; arguments as for `statistics_table`."""
    return Table(
        f"{name}-time",
        f"Wall-clock for {what}: the service's compute time, and what the client waited.",
        ("Method", HEADINGS[varied], "Time (ms)", "Client latency (ms)"),
        [
            (
                entrant.label,
                str(value),
                *(
                    mean_and_spread(column(data, entrant, measure, **{varied: value}), 1)
                    for measure in ("compute_ms", "latency_ms")
                ),
            )
            for value, entrant in product(values, entrants)
        ],
    )
