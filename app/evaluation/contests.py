"""A learned model against plain searches that take as long: refined plans for unsure plants."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from app.evaluation import grid
from app.evaluation.case import Case
from app.evaluation.entrants import DATASET_PRIOR
from app.evaluation.question import Entrant
from app.evaluation.statistics import percent
from app.evaluation.suite import Claim, Parts
from app.figures.style import BLACK, Look
from app.planning.uncertainty.uncertainty import FEW_MOTIONS

SEARCH = Entrant("Plain search", DATASET_PRIOR.fields, Look(BLACK, "*", "-"))
"""From motions that are drawn: what the network has to beat in the same time."""
SEARCHES = (64, 128, 256, 512, 1024)
"""Motions of plain searches, among which the one that takes as long is read off."""
NUM_CANDIDATES = 16
ERROR, MILLISECONDS = "executed_error", "compute_ms"
PLANT, MACHINES = "plant", "machines"
"""What the tasks are on: the paper's plant, or each on a random machine."""


class Contest(NamedTuple):
    """Where a model and plain searches are asked for the same plans."""

    model: Entrant
    on: str
    off_by: float
    """By how much friction may be off."""
    horizon: int | None = None
    """Steps; None for what the service does by default."""

    def __str__(self) -> str:
        """Write it as a title has it."""
        off = f"friction off by up to {percent(self.off_by)}"
        if self.on == MACHINES:
            return f"random machines, {off}, shares of the reach"
        steps = f", {self.horizon} steps" if self.horizon else ""
        return f"{off}{steps}, m"

    @property
    def asked(self) -> Iterator[tuple[Entrant, int]]:
        """Who is asked, and for a search from how many motions."""
        yield self.model, FEW_MOTIONS
        for motions in SEARCHES:
            yield SEARCH, motions

    def report(self, data: pd.DataFrame, part: str) -> Parts:
        """Tell who is nearer, and whether the model is nearer than a search in the same time.

        Args:
            data: rows of the executed errors, those of this contest with its name as `contest`.
            part: name of the table.
        """
        here = {"contest": str(self)}
        learned, *rivals = (
            Case(data, entrant, here | {"motions": motions}) for entrant, motions in self.asked
        )
        asked = [learned] if len(learned.rows) else []

        def less(case: Case) -> str:
            return learned.less(case, ERROR).shown(4, "+") if asked and case is not learned else ""

        yield grid.table(
            f"Refined robust plans and plain searches, {self}: mean executed error, what the "
            "model's is more than it with the 95 % bootstrap interval over the tasks, and the "
            "service's time.",
            asked + rivals,
            (
                grid.METHOD,
                grid.Column("Motions", lambda case: str(case.where["motions"])),
                grid.mean("Mean", ERROR, 4),
                grid.Column("Model less search", less),
                grid.median("ms", MILLISECONDS, 1),
            ),
            part=part,
        )
        if asked:
            yield self._verdict(learned, rivals)

    def _verdict(self, learned: Case, rivals: list[Case]) -> Claim:
        """Compare with the largest search that takes no longer."""
        took = _time(learned)
        within = [rival for rival in rivals if _time(rival) <= took]
        rival = within[-1] if within else rivals[0]
        difference = learned.less(rival, ERROR)
        return Claim(
            "A learned robust plan is nearer than that of a plain search in the same time (beyond "
            f"the paper), {self}.",
            difference.high < 0,
            f"The model takes {took:.1f} ms, the search of {rival.where['motions']} motions "
            f"{_time(rival):.1f}; its error less the search's is {difference.shown(4, '+')}.",
        )


def _time(case: Case) -> float:
    return float(np.median(case.values(MILLISECONDS)))
