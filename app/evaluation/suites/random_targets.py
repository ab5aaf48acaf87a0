"""Beyond the paper's targets: random transitions, and how often each method gets there."""

from collections.abc import Sequence
from itertools import product

import numpy as np
import pandas as pd

from app.evaluation import grid
from app.evaluation.case import Case, cases_of
from app.evaluation.entrants import ENTRANTS
from app.evaluation.plots import LEAST_ERROR, LOOKS, draw_legend
from app.evaluation.section import Picture, Section, Table
from app.evaluation.suite import Answered, Size, Suite
from app.evaluation.tasks import MAX_POSITION, MAX_VELOCITY, Task, transition_tasks
from app.figures.style import PAGE_INCHES, new_figure

ERROR = "terminal_error"
TITLES = {ERROR: "Error", "gap": "Gap"}
SUCCESSES = (0.01, 0.05, 0.1)
"""Errors, or gaps, that count as success, m."""
LARGEST_GAP = 1.0
"""Up to which the figure shows gaps, m."""


class RandomTargets(Suite):
    """Success rates over random pairs of start and target."""

    name = "random-targets"
    purpose = "500 random starts and targets: success rates, K = 16 and 32"
    FULL = Size(budgets=(16, 32), tasks=500)
    QUICK = Size(budgets=(16,), tasks=12)

    def tasks(self) -> list[Task]:
        return transition_tasks(self.size.tasks, self.seed)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        budgets = self.size.budgets
        cases = cases_of(data, ENTRANTS, num_candidates=budgets)
        reachable, unreachable = data[data.reachable], data[~data.reachable]
        return Section(
            title="Random targets",
            introduction=(
                f"{self.size.tasks} random pairs of a start and a target, with positions in "
                f"[-{MAX_POSITION:g}, {MAX_POSITION:g}] m and velocities in [-{MAX_VELOCITY:g}, "
                f"{MAX_VELOCITY:g}] m/s, every other target at rest; one run. The floor "
                "is the least terminal error of any plan, above zero where no control reaches the "
                "target within the horizon; the gap is the error less that floor: what the method "
                "itself adds."
            ),
            tables=(
                _errors(self.name, "All", data, budgets),
                *(
                    _errors(f"{self.name}-{kind.lower()}", kind, part, budgets, *more)
                    for kind, part, *more in (
                        ("Reachable", reachable),
                        ("Unreachable", unreachable, "gap"),
                    )
                    if len(part)
                ),
                grid.statistics(self.name, cases, ERROR, digits=4),
                grid.times(self.name, cases, "a plan"),
                *grid.wins(self.name, cases, ERROR, "Terminal error"),
            ),
            pictures=(_picture(data, budgets),),
        )


def _errors(name: str, kind: str, data: pd.DataFrame, budgets: Sequence[int], *more: str) -> Table:
    """Make a table of errors; success is counted by the error, and by `more` measures."""
    return grid.of_cases(
        name,
        f"{kind} targets ({data.task.nunique()}): share of the tasks on which the terminal error "
        f"{'or the gap ' * ('gap' in more)}is at most so much, mean ± standard deviation and "
        "median of the error, and the mean gap.",
        cases_of(data, ENTRANTS, num_candidates=budgets),
        *(
            grid.within(f"{TITLES[measure]} within {limit:g} m", measure, limit)
            for measure, limit in product((ERROR, *more), SUCCESSES)
        ),
        grid.spread("Mean error (m)", ERROR, 4),
        grid.median("Median error (m)", ERROR, 4),
        grid.mean("Mean gap (m)", "gap", 4),
    )


def _picture(data: pd.DataFrame, budgets: Sequence[int]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.0)
    panels = figure.subplots(1, len(budgets), sharey=True, squeeze=False)[0]
    for axes, k in zip(panels, budgets, strict=True):
        for entrant in ENTRANTS:
            gaps = np.sort(Case(data, entrant, {"num_candidates": k}).values("gap"))
            gaps = gaps.clip(LEAST_ERROR)
            axes.stairs(
                np.arange(1, len(gaps) + 1) / len(gaps),
                [*gaps, max(gaps[-1], LARGEST_GAP)],
                baseline=None,
                color=LOOKS[entrant].color,
                ls=LOOKS[entrant].line,
                label=entrant.label,
            )
        axes.set(
            title=f"K = {k}",
            xlabel="gap to the floor e (m)",
            xscale="log",
            xlim=(LEAST_ERROR, LARGEST_GAP),
            xticks=np.geomspace(LEAST_ERROR, LARGEST_GAP, 4),
            ylim=(0, 1.02),
        )
    panels[0].set_ylabel("share of tasks within e")
    draw_legend(figure, "outside right upper")
    return Picture(
        "random-targets",
        "Random targets: share of the tasks whose gap to the floor is at most e. What a line has "
        "at the left edge is the share of plans within a micrometre of the floor; what it lacks at "
        "the right edge, of those more than a metre away.",
        figure,
    )
