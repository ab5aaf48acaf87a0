"""Beyond the paper's targets: random transitions, and how often each method gets there."""

from itertools import product

import pandas as pd

from app.evaluation import grid, plots
from app.evaluation.case import Case, cases_of
from app.evaluation.entrants import ENTRANTS
from app.evaluation.suite import Parts, Picture, Size, Suite, Table
from app.evaluation.tasks import MAX_POSITION, MAX_VELOCITY, transition_tasks
from app.figures.style import new_figure

ERROR = "terminal_error"
TITLES = {ERROR: "Error", "gap": "Gap"}
SUCCESSES = (0.01, 0.05, 0.1)
"""Errors, or gaps, that count as success, m."""
LARGEST_GAP = 1.0
"""Up to which the figure shows gaps, m."""


class RandomTargets(Suite):
    """500 random starts and targets: success rates, K = 16 and 32."""

    name = "random-targets"
    title = "Random targets"
    draw_tasks = staticmethod(transition_tasks)
    FULL = Size(budgets=(16, 32), tasks=500)
    QUICK = Size(budgets=(16,), tasks=12)

    def report(self, data: pd.DataFrame) -> Parts:
        cases = cases_of(data, ENTRANTS, num_candidates=self.size.budgets)
        yield (
            f"{self.size.tasks} random pairs of a start and a target, with positions in "
            f"[-{MAX_POSITION:g}, {MAX_POSITION:g}] m and velocities in [-{MAX_VELOCITY:g}, "
            f"{MAX_VELOCITY:g}] m/s, every other target at rest; one run. The floor is the least "
            "terminal error of any plan, above zero where no control reaches the target within "
            "the horizon; the gap is the error less that floor: what the method itself adds."
        )
        yield self._errors(data, "All", ERROR)
        for kind, part, *counted in (
            ("Reachable", data[data.reachable], ERROR),
            ("Unreachable", data[~data.reachable], ERROR, "gap"),
        ):
            if len(part):
                yield self._errors(part, kind, *counted, part=kind.lower())
        yield grid.statistics(cases, ERROR, digits=4)
        yield grid.times(cases, "a plan")
        yield from grid.wins(cases, ERROR, "Terminal error")
        yield self._picture(cases)

    def _errors(self, data: pd.DataFrame, kind: str, *counted: str, part: str = "") -> Table:
        """Make a table of errors; success is that a measure of `counted` is small."""
        return grid.of_cases(
            f"{kind} targets ({data.task.nunique()}): share of the tasks on which the terminal "
            f"error {'or the gap ' * ('gap' in counted)}is at most so much, mean ± standard "
            "deviation and median of the error, and the mean gap.",
            cases_of(data, ENTRANTS, num_candidates=self.size.budgets),
            *(
                grid.within(f"{TITLES[measure]} within {limit:g} m", measure, limit)
                for measure, limit in product(counted, SUCCESSES)
            ),
            grid.spread("Mean error (m)", ERROR, 4),
            grid.median("Median error (m)", ERROR, 4),
            grid.mean("Mean gap (m)", "gap", 4),
            part=part,
        )

    def _picture(self, cases: list[Case]) -> Picture:
        figure = new_figure(3.0)
        panels = figure.subplots(1, len(self.size.budgets), sharey=True, squeeze=False)[0]
        # A panel for each K, and in it a line for each method: as the cases come.
        for axes, case in zip(panels.repeat(len(ENTRANTS)), cases, strict=True):
            plots.draw_shares(axes, case, "gap", LARGEST_GAP, "gap to the floor e (m)")
        panels[0].set_ylabel("share of tasks within e")
        return plots.with_legend(
            figure,
            "Random targets: share of the tasks whose gap to the floor is at most e. What a line "
            "has at the left edge is the share of plans within a micrometre of the floor; what it "
            "lacks at the right edge, of those more than a metre away.",
        )
