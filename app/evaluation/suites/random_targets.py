"""Beyond the paper's targets: random transitions, and how often each method gets there."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
import pandas as pd

from app.evaluation.cells import mean_and_spread, percent
from app.evaluation.comparison import column, per_unit, rows_of, wins
from app.evaluation.entrants import ENTRANTS
from app.evaluation.looks import LOOKS
from app.evaluation.plots import LEAST_ERROR
from app.evaluation.question import Entrant, Question, question_to
from app.evaluation.section import Picture, Section, Table
from app.evaluation.suite import Answered, Suite
from app.evaluation.tables import statistics_table, times_table
from app.evaluation.tasks import MAX_POSITION, MAX_VELOCITY, random_transitions
from app.figures.style import PAGE_INCHES, new_figure
from app.wire.requests import PlanRequest

SUCCESSES = (0.01, 0.05, 0.1)
"""Errors, or gaps, that count as success, m."""
LARGEST_GAP = 1.0
"""Up to which the figure shows gaps, m."""


@dataclass(frozen=True)
class RandomTargets(Suite):
    """Success rates over random pairs of start and target."""

    name: ClassVar[str] = "random-targets"
    purpose: ClassVar[str] = "500 random starts and targets: success rates, K = 16 and 32"

    @property
    def budgets(self) -> tuple[int, ...]:
        """K."""
        return (16,) if self.quick else (16, 32)

    @property
    def num_tasks(self) -> int:
        """How many transitions."""
        return 12 if self.quick else 500

    def questions(self) -> Iterator[Question]:
        for k, entrant in product(self.budgets, ENTRANTS):
            yield from transition_questions(self.seed, self.num_tasks, entrant, k)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        reachable = data[data.reachable]
        unreachable = data[~data.reachable]
        return Section(
            title="Random targets",
            introduction=(
                f"{self.num_tasks} random pairs of a start and a target, with positions in "
                f"[-{MAX_POSITION:g}, {MAX_POSITION:g}] m and velocities in [-{MAX_VELOCITY:g}, "
                f"{MAX_VELOCITY:g}] m/s, every other target at rest; one run. The floor "
                "is the least terminal error of any plan, above zero where no control reaches the "
                "target within the horizon; the gap is the error less that floor: what the method "
                "itself adds."
            ),
            tables=(
                _errors(data, self.budgets, "random-targets", "All", ["terminal_error"]),
                *(
                    _errors(part, self.budgets, f"random-targets-{kind}", kind.title(), successes)
                    for kind, part, successes in (
                        ("reachable", reachable, ["terminal_error"]),
                        ("unreachable", unreachable, ["terminal_error", "gap"]),
                    )
                    if len(part)
                ),
                statistics_table(
                    data,
                    self.name,
                    "terminal_error",
                    ENTRANTS,
                    "num_candidates",
                    self.budgets,
                    digits=4,
                ),
                times_table(data, self.name, "a plan", ENTRANTS, "num_candidates", self.budgets),
                *(_wins(data, k) for k in self.budgets),
            ),
            pictures=(_picture(data, self.budgets),),
        )


def transition_questions(
    seed: int,
    num_tasks: int,
    entrant: Entrant,
    num_candidates: int,
    trajectories: bool = False,
) -> Iterator[Question]:
    """Ask `entrant` for a plan of each random transition.

    Args:
        seed: decides the transitions and the requests' seeds.
        num_tasks: transitions.
        entrant: who plans.
        num_candidates: K.
        trajectories: whether the controls are wanted, too.
    """
    for task, (start, target) in enumerate(random_transitions(num_tasks, seed)):
        fields = {"initial_state": start, "target_state": target}
        yield question_to(
            entrant, PlanRequest, fields, num_candidates, seed, task, 0, trajectories=trajectories
        )


def _errors(
    data: pd.DataFrame, budgets: tuple[int, ...], name: str, kind: str, successes: list[str]
) -> Table:
    """Make a table of errors; `successes` are the measures by which success is counted."""
    rows = []
    for k, entrant in product(budgets, ENTRANTS):
        of = rows_of(data, entrant, num_candidates=k)
        rows.append(
            (
                entrant.label,
                str(k),
                *(
                    percent((of[measure] <= limit).mean())
                    for measure, limit in product(successes, SUCCESSES)
                ),
                mean_and_spread(of.terminal_error, 4),
                f"{of.terminal_error.median():.4f}",
                f"{of.gap.mean():.4f}",
            )
        )
    titles = {"terminal_error": "Error", "gap": "Gap"}
    return Table(
        name,
        f"{kind} targets ({data.task.nunique()}): share of the tasks on which the terminal error "
        f"{'or the gap ' * ('gap' in successes)}is at most so much, mean ± standard deviation and "
        "median of the error, and the mean gap.",
        (
            "Method",
            "K",
            *(
                f"{titles[measure]} within {limit:g} m"
                for measure, limit in product(successes, SUCCESSES)
            ),
            "Mean error (m)",
            "Median error (m)",
            "Mean gap (m)",
        ),
        rows,
    )


def _wins(data: pd.DataFrame, k: int) -> Table:
    errors = {
        entrant: per_unit(data, entrant, "terminal_error", num_candidates=k) for entrant in ENTRANTS
    }
    return wins(errors, f"random-targets-wins-{k}", f"Terminal error, K = {k}")


def _picture(data: pd.DataFrame, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.0)
    panels = figure.subplots(1, len(budgets), sharey=True, squeeze=False)[0]
    for axes, k in zip(panels, budgets, strict=True):
        for entrant in ENTRANTS:
            gaps = np.sort(column(data, entrant, "gap", num_candidates=k)).clip(LEAST_ERROR)
            axes.stairs(
                np.arange(1, len(gaps) + 1) / len(gaps),
                [*gaps, max(gaps[-1], LARGEST_GAP)],
                baseline=None,
                color=LOOKS[entrant].color,
                ls=LOOKS[entrant].line,
                label=entrant.label,
            )
        axes.set_xscale("log")
        axes.set_xlim(LEAST_ERROR, LARGEST_GAP)
        axes.set_xticks(np.geomspace(LEAST_ERROR, LARGEST_GAP, 4))
        axes.set_ylim(0, 1.02)
        axes.set_xlabel("gap to the floor e (m)")
        axes.set_title(f"K = {k}")
    panels[0].set_ylabel("share of tasks within e")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper")
    return Picture(
        "random-targets",
        "Random targets: share of the tasks whose gap to the floor is at most e. What a line has "
        "at the left edge is the share of plans within a micrometre of the floor; what it lacks at "
        "the right edge, of those more than a metre away.",
        figure,
    )
