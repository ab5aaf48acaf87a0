"""One learned model for every machine: random machines out of its range, with a task each."""

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
import pandas as pd

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of, taking_part
from app.evaluation.entrants import CEM, DATASET_PRIOR, DIFFUSION, MPPI
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Parts, Picture, Row, Size, Suite
from app.evaluation.tasks import random_machine_tasks, scale_of
from app.figures.style import new_figure
from app.planning.plant.natural_units import in_natural_units
from app.planning.plant.system import System

ENTRANTS = (DIFFUSION, MPPI, CEM, DATASET_PRIOR)
GAP = "relative_gap"
PERCENT = 100
QUANTILES = (0.5, 0.9, 1.0)
LIMITS = (0.005, 0.02)
"""Gaps over the reach below which the median and the 0.9 quantile are to be."""
STICKY = (0.0, 0.3, 0.6, 1.0)
"""Edges of the classes of machines: static friction over what full control makes of the mass."""


class AnyMachine(Suite):
    """200 random machines with a task each, by the model that covers them, K = 1 and 16."""

    name = "any-machine"
    title = "One model for every machine"
    draw_tasks = staticmethod(random_machine_tasks)
    FULL = Size(budgets=(1, 16), tasks=200, entrants=ENTRANTS)
    QUICK = Size(budgets=(1, 4), tasks=8, entrants=ENTRANTS)

    def questions(self) -> Iterator[Question]:
        for k in self.size.budgets:
            for entrant in self.size.entrants:
                yield from self.ask(entrant, k, if_covered=entrant == DIFFUSION)

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        system = question.plan.system
        assert isinstance(system, System)
        natural = in_natural_units(system.plant)
        (row,) = super().rows(question, answer)
        return [
            {
                **row,
                GAP: row["gap"] / scale_of(system).reach,
                "static_over_limit": max(natural.static_forward, natural.static_backward),
            }
        ]

    def report(self, data: pd.DataFrame) -> Parts:
        present = taking_part(data, self.size.entrants)
        cases = cases_of(data, present, num_candidates=self.size.budgets)
        tasks = data.drop_duplicates("task")
        yield (
            f"{data.task.nunique()} random machines of all gains, limits and time steps, with a "
            "task each as in `random-machines`. Static friction takes 2 to 90 % of what full "
            "control makes of the mass, Coulomb friction 30 to 100 % of that; half of the machines "
            "have other frictions backward, half a bias, one of ten Stribeck's effect; damping "
            "takes up to 40 horizons' worth of velocity. None of them was in the training data. "
            f"{tasks.reachable.mean():.0%} of the targets are within reach; the others count by "
            "their gap to the floor, too. Gaps are shares of the reach."
        )
        yield grid.of_cases(
            "Gap to the floor over the reach (%): quantiles over the machines, and the mean.",
            cases,
            *(_quantile(share) for share in QUANTILES),
            grid.Column("Mean", lambda case: f"{PERCENT * case.mean(GAP):.2f}"),
            grid.median("Compute (ms)", "compute_ms", 1),
        )
        yield grid.of_cases(
            "The median gap over the reach (%) by what static friction takes of the limit.",
            cases,
            *(_median_where(low, high) for low, high in pairwise(STICKY)),
            part="stickiness",
        )
        yield _picture(cases, len(present))
        if DIFFUSION in present:
            yield _keeps_below(Case(data, DIFFUSION, {"num_candidates": self.size.budgets[-1]}))


def _quantile(share: float) -> grid.Column[Case]:
    heading = {0.5: "Median", 1.0: "Largest"}.get(share, f"{share:.0%}")
    return grid.Column(
        heading, lambda case: f"{PERCENT * np.quantile(case.values(GAP), share):.2f}"
    )


def _median_where(low: float, high: float) -> grid.Column[Case]:
    """Show the median over machines of a class, nothing where there are none."""

    def shown(case: Case) -> str:
        rows = case.rows
        gaps = rows[rows.static_over_limit.between(low, high, inclusive="left")][GAP]
        return f"{PERCENT * gaps.median():.2f}" if len(gaps) else ""

    return grid.Column(f"{low:.0%} to {high:.0%}", shown)


def _picture(cases: list[Case], num_entrants: int) -> Picture:
    figure = new_figure(3.0)
    budgets = list(dict.fromkeys(case.place for case in cases))
    panels = figure.subplots(1, len(budgets), sharey=True, squeeze=False)[0]
    for axes, case in zip(panels.repeat(num_entrants), cases, strict=True):
        plots.draw_shares(axes, case, GAP, 1.0, "gap to the floor over the reach, e")
    panels[0].set_ylabel("share of machines within e")
    return plots.with_legend(
        figure, "Random machines: share of those whose plan's gap over the reach is at most e."
    )


def _keeps_below(case: Case) -> Claim:
    median, most = np.quantile(case.values(GAP), QUANTILES[:2])
    return Claim(
        f"One model serves every machine (beyond the paper): {case.place}, the median gap is at "
        f"most {LIMITS[0]:.1%} of the reach, and that of nine in ten at most {LIMITS[1]:.0%}.",
        bool(median <= LIMITS[0] and most <= LIMITS[1]),
        f"The median is {median:.2%}, the 0.9 quantile {most:.2%}.",
    )
