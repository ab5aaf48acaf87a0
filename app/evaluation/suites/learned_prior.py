"""What the learned prior buys once every method is refined: the same tasks for all, paired."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any

import pandas as pd

from app.evaluation import grid
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case
from app.evaluation.entrants import DATASET_PRIOR, DIFFUSION, UNIFORM
from app.evaluation.plots import Line, draw_legend, draw_lines
from app.evaluation.question import Question
from app.evaluation.section import Picture, Section
from app.evaluation.statistics import Interval
from app.evaluation.suite import Answered, Row, Size, Suite
from app.evaluation.tasks import Task, transition_tasks
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
    "success": grid.share("Success", "success", 1),
    "exact": grid.share("Exact", "exact", 1),
    "control_energy": grid.mean("Energy", "control_energy", 1),
    "control_smoothness": grid.mean("Control smoothness", "control_smoothness", 2),
    "stuck_steps": grid.mean("Stuck steps", "stuck_steps", 1),
}
"""Columns of the data, and how the table shows them."""
DRAWN = {
    "success": "Δ success (share of tasks)",
    "control_energy": "Δ energy (m²/s⁴)",
    "control_smoothness": "Δ control smoothness (m²/s⁴)",
}
WIDTH = 0.24
"""Over which the lines of a panel are spread, which else would hide each other."""


class LearnedPrior(Suite):
    """Learned prior, dataset prior and uniform noise as starts of refinement."""

    name = "learned-prior"
    purpose = "What the learned prior buys once all are refined: 500 random tasks"
    FULL = Size(budgets=BUDGETS, tasks=500)
    QUICK = Size(budgets=BUDGETS, tasks=8)

    def tasks(self) -> list[Task]:
        return transition_tasks(self.size.tasks, self.seed)

    def questions(self) -> Iterator[Question]:
        for way, k, entrant in COMPARED:
            yield from self.ask(entrant.asking(**REFINED_BY[way]), k, refined_by=way)

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        gap = answer.content["gap"]
        return [
            {**row, "success": gap < SUCCESS_GAP, "exact": gap < EXACT_GAP}
            for row in super().rows(question, answer)
        ]

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        cases = [
            Case(data, entrant, {"refined_by": way, "num_candidates": k})
            for way, k, entrant in COMPARED
        ]
        refined_by, k = grid.varied("refined_by"), grid.varied("num_candidates")
        learned = [case for case in cases if case.entrant == DIFFUSION]
        return Section(
            title="What the learned prior buys once everybody is refined",
            introduction=(
                f"The same {self.size.tasks} tasks for everybody: starts from the training range, "
                "every other target moving. Every plan is refined: by descent within the motion "
                "that the method proposed, with repair, and with repair for the least energy. "
                f"Success ends within {SUCCESS_GAP:g} m of the floor, exact within {EXACT_GAP:g} m."
            ),
            tables=(
                grid.table(
                    self.name,
                    "Shares and means over all tasks, whether plans succeed or not; energy and "
                    "control smoothness in m²/s⁴.",
                    cases,
                    (refined_by, grid.METHOD, k, *MEASURES.values()),
                ),
                grid.table(
                    f"{self.name}-differences",
                    f"{DIFFUSION.label} less {DATASET_PRIOR.label} at the same K: means of the "
                    "paired differences, with 95 % bootstrap intervals over the tasks.",
                    learned,
                    (
                        refined_by,
                        k,
                        *(
                            grid.less(column.heading, measure, DATASET_PRIOR)
                            for measure, column in MEASURES.items()
                        ),
                    ),
                ),
                grid.table(
                    f"{self.name}-time",
                    "The service's compute time for a plan, with its refinement: medians over the "
                    "tasks.",
                    cases,
                    (refined_by, grid.METHOD, k, grid.median("ms a plan", "compute_ms", 2)),
                ),
            ),
            pictures=(_picture(learned),),
        )


def _picture(learned: list[Case]) -> Picture:
    figure = new_figure(PAGE_INCHES, 2.5)
    for axes, (measure, label) in zip(figure.subplots(1, len(DRAWN)), DRAWN.items(), strict=True):
        axes.axhline(0, color=GREY, lw=0.8)
        bought: dict[str, list[Interval]] = defaultdict(list)
        for case in learned:
            bought[case.where["refined_by"]].append(
                case.less(case.with_entrant(DATASET_PRIOR), measure)
            )
        lines = [Line(way, LOOKS[way], intervals) for way, intervals in bought.items()]
        draw_lines(axes, lines, range(len(BUDGETS)), WIDTH)
        axes.set_xticks(range(len(BUDGETS)), labels=[str(k) for k in BUDGETS])
        axes.set(xlabel="candidates K", ylabel=label)
    draw_legend(figure, "outside upper center", columns=len(LOOKS))
    return Picture(
        "learned-prior",
        f"{DIFFUSION.label} less {DATASET_PRIOR.label} (Δ) at the same K, by what both are refined "
        "by: means of the paired differences, with 95 % intervals.",
        figure,
    )
