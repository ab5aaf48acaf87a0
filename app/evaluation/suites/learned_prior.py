"""What the learned prior buys once every method is refined: the same tasks for all, paired."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from app.evaluation.answer_log import Answer
from app.evaluation.cells import percent, with_interval
from app.evaluation.comparison import column, per_unit, rows_of
from app.evaluation.entrants import DATASET_PRIOR, DIFFUSION, UNIFORM
from app.evaluation.plots import draw_intervals
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Picture, Section, Table
from app.evaluation.statistics import Interval, paired_difference
from app.evaluation.suite import Answered, Row, Suite
from app.evaluation.suites.random_targets import transition_questions
from app.figures.style import BLUE, GREEN, GREY, PAGE_INCHES, RED, Look, new_figure

SUCCESS_GAP = 1e-3
EXACT_GAP = 1e-6
"""A plan ends less than this above the floor (m)."""

DESCENT, REPAIR = "descent alone", "descent and repair"
LEAST_ENERGY = "descent, repair, least energy"
REFINED_BY: dict[str, dict[str, Any]] = {
    DESCENT: {"refine": {"repair": False}},
    REPAIR: {"refine": True},
    LEAST_ENERGY: {"refine": True, "objective": "control_energy"},
}
"""Fields of the request."""
LOOKS = {
    DESCENT: Look(BLUE, "o", "-"),
    REPAIR: Look(RED, "s", "--"),
    LEAST_ENERGY: Look(GREEN, "^", ":"),
}

BUDGETS = (1, 4, 16)
EQUAL_TIME_BUDGETS = (64, 256, 1024)
"""K of the dataset prior among which the one that takes as long as Action Diffusion is read off."""
COMPARED = (
    *product((DESCENT, REPAIR), BUDGETS, (DIFFUSION, DATASET_PRIOR, UNIFORM)),
    *product((LEAST_ENERGY,), BUDGETS, (DIFFUSION, DATASET_PRIOR)),
    *product((LEAST_ENERGY,), EQUAL_TIME_BUDGETS, (DATASET_PRIOR,)),
)
"""Refined by what, K, and who proposes."""

MEASURES = {
    "success": "Success",
    "exact": "Exact",
    "control_energy": "Energy",
    "control_smoothness": "Roughness",
    "stuck_steps": "Stuck steps",
}
"""Columns of the data, and their headings."""
DRAWN = {
    "success": "Δ success (share of tasks)",
    "control_energy": "Δ energy (m²/s⁴)",
    "control_smoothness": "Δ roughness (m²/s⁴)",
}
SHIFT = 0.12
"""Between the lines of a panel, which else would hide each other."""


@dataclass(frozen=True)
class LearnedPrior(Suite):
    """Learned prior, dataset prior and uniform noise as starts of refinement."""

    name: ClassVar[str] = "learned-prior"
    purpose: ClassVar[str] = "What the learned prior buys once all are refined: 500 random tasks"

    @property
    def num_tasks(self) -> int:
        """How many tasks."""
        return 8 if self.quick else 500

    def questions(self) -> Iterator[Question]:
        for way, k, entrant in COMPARED:
            refined = Entrant(entrant.label, {**entrant.fields, **REFINED_BY[way]})
            for question in transition_questions(self.seed, self.num_tasks, refined, k):
                yield replace(question, labels={"refined_by": way, **question.labels})

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        gap = answer.content["gap"]
        return [
            {**row, "success": gap < SUCCESS_GAP, "exact": gap < EXACT_GAP}
            for row in super().rows(question, answer)
        ]

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        return Section(
            title="What the learned prior buys once everybody is refined",
            introduction=(
                f"The same {self.num_tasks} tasks for everybody: starts from the training range, "
                "every other target moving. Every plan is refined: by descent within the motion "
                "that the method proposed, with repair, and with repair for the least energy. "
                f"Success ends within {SUCCESS_GAP:g} m of the floor, exact within {EXACT_GAP:g} m."
            ),
            tables=(_results(data), _differences(data), _times(data)),
            pictures=(_picture(data),),
        )


def _refined_by(data: pd.DataFrame, way: str) -> pd.DataFrame:
    return data[data.refined_by == way]


def _results(data: pd.DataFrame) -> Table:
    rows = []
    for way, k, entrant in COMPARED:
        of = rows_of(_refined_by(data, way), entrant, num_candidates=k)
        rows.append(
            (
                way,
                entrant.label,
                str(k),
                percent(of.success.mean(), 1),
                percent(of.exact.mean(), 1),
                f"{of.control_energy.mean():.1f}",
                f"{of.control_smoothness.mean():.2f}",
                f"{of.stuck_steps.mean():.1f}",
            )
        )
    return Table(
        "learned-prior",
        "Shares and means over all tasks, whether plans succeed or not; energy and roughness in "
        "m²/s⁴.",
        ("Refined by", "Method", "K", *MEASURES.values()),
        rows,
    )


def _differences(data: pd.DataFrame) -> Table:
    return Table(
        "learned-prior-differences",
        f"{DIFFUSION.label} less {DATASET_PRIOR.label} at the same K: means of the paired "
        "differences, with 95 % bootstrap intervals over the tasks.",
        ("Refined by", "K", *MEASURES.values()),
        [
            (way, str(k), *(with_interval(_bought(data, way, k, of), 3, "+") for of in MEASURES))
            for way, k in product(REFINED_BY, BUDGETS)
        ],
    )


def _times(data: pd.DataFrame) -> Table:
    return Table(
        "learned-prior-time",
        "The service's compute time for a plan, with its refinement: medians over the tasks.",
        ("Refined by", "Method", "K", "ms a plan"),
        [
            (way, entrant.label, str(k), f"{np.median(times):.2f}")
            for way, k, entrant in COMPARED
            for times in [column(_refined_by(data, way), entrant, "compute_ms", num_candidates=k)]
        ],
    )


def _bought(data: pd.DataFrame, way: str, k: int, measure: str) -> Interval:
    """Return what the learned prior has more than the dataset prior."""
    of_way = _refined_by(data, way)
    learned, control = (
        per_unit(of_way, entrant, measure, num_candidates=k)
        for entrant in (DIFFUSION, DATASET_PRIOR)
    )
    return paired_difference(learned, control)


def _picture(data: pd.DataFrame) -> Picture:
    figure = new_figure(PAGE_INCHES, 2.5)
    for axes, (measure, label) in zip(figure.subplots(1, len(DRAWN)), DRAWN.items(), strict=True):
        axes.axhline(0, color=GREY, lw=0.8)
        for place, (way, look) in enumerate(LOOKS.items()):
            positions = np.arange(len(BUDGETS)) + SHIFT * (place - 1)
            found = [_bought(data, way, k, measure) for k in BUDGETS]
            draw_intervals(axes, look, way, positions, found)
        axes.set_xticks(range(len(BUDGETS)), labels=[str(k) for k in BUDGETS])
        axes.set_xlabel("candidates K")
        axes.set_ylabel(label)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(LOOKS))
    return Picture(
        "learned-prior",
        f"{DIFFUSION.label} less {DATASET_PRIOR.label} (Δ) at the same K, by what both are refined "
        "by: means of the paired differences, with 95 % intervals.",
        figure,
    )
