"""What the learned prior buys once every method is refined: the same tasks for all, paired."""

from collections.abc import Iterable, Iterator
from itertools import product

import pandas as pd

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case
from app.evaluation.entrants import DATASET_PRIOR, DIFFUSION, UNIFORM
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Parts, Picture, Row, Size, Suite
from app.evaluation.tasks import transition_tasks
from app.figures.style import BLUE, GREEN, GREY, RED, Look, new_figure
from app.wire.requests import PlanRequest

SUCCESS_GAP = 1e-3
EXACT_GAP = 1e-6
"""A plan ends less than this above the floor (m)."""

DESCENT = Entrant("descent alone", {"refine": {"repair": False}}, Look(BLUE, "o", "-"))
REPAIR = Entrant("descent and repair", {"refine": True}, Look(RED, "s", "--"))
LEAST_ENERGY = Entrant(
    "descent, repair, least energy",
    {"refine": True, "objective": "control_energy"},
    Look(GREEN, "^", ":"),
)
WAYS = (DESCENT, REPAIR, LEAST_ENERGY)
"""By what plans are refined."""

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
    """What the learned prior buys once all are refined: 500 random tasks."""

    name = "learned-prior"
    title = "What the learned prior buys once everybody is refined"
    draw_tasks = staticmethod(transition_tasks)
    FULL = Size(budgets=BUDGETS, tasks=500)
    QUICK = Size(budgets=BUDGETS, tasks=8)

    def questions(self) -> Iterator[Question]:
        for way, k, entrant in COMPARED:
            yield from self.ask(entrant.asking(**way.fields), k, refined_by=way.label)

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        gap = answer.content["gap"]
        request = question.request
        assert isinstance(request, PlanRequest)
        (row,) = super().rows(question, answer)
        return [
            {
                **row,
                "success": gap < SUCCESS_GAP,
                "exact": gap < EXACT_GAP,
                "moving": request.target_state[1] != 0,
            }
        ]

    def report(self, data: pd.DataFrame) -> Parts:
        cases = [
            Case(data, entrant, {"refined_by": way.label, "num_candidates": k})
            for way, k, entrant in COMPARED
        ]
        refined_by, k = grid.varied("refined_by"), grid.varied("num_candidates")
        learned = [case for case in cases if case.entrant == DIFFUSION]
        yield (
            f"The same {self.size.tasks} tasks for everybody: starts from the training range, "
            "every other target moving. Every plan is refined: by descent within the motion that "
            "the method proposed, with repair, and with repair for the least energy. Success ends "
            f"within {SUCCESS_GAP:g} m of the floor, exact within {EXACT_GAP:g} m."
        )
        yield grid.table(
            "Shares and means over all tasks, whether plans succeed or not; energy and control "
            "smoothness in m²/s⁴.",
            cases,
            (refined_by, grid.METHOD, k, *MEASURES.values()),
        )
        differences = (
            grid.less(column.heading, measure, DATASET_PRIOR)
            for measure, column in MEASURES.items()
        )
        yield grid.table(
            f"{DIFFUSION.label} less {DATASET_PRIOR.label} at the same K: means of the paired "
            "differences, with 95 % bootstrap intervals over the tasks.",
            learned,
            (refined_by, k, *differences),
            part="differences",
        )
        yield grid.table(
            f"{DESCENT.label.capitalize()}, by the target: share of the tasks that end exactly.",
            [case for case in cases if case.where["refined_by"] == DESCENT.label],
            (
                grid.METHOD,
                k,
                grid.share("Within reach", "exact", 1, reachable=True),
                grid.share("At rest", "exact", 1, reachable=True, moving=False),
                grid.share("Moving", "exact", 1, reachable=True, moving=True),
                grid.share("Beyond reach", "exact", 1, reachable=False),
            ),
            part="targets",
        )
        yield grid.table(
            "The service's compute time for a plan, with its refinement: medians over the tasks.",
            cases,
            (refined_by, grid.METHOD, k, grid.median("ms a plan", "compute_ms", 2)),
            part="time",
        )
        yield _picture(learned)


def _picture(learned: list[Case]) -> Picture:
    figure = new_figure(2.5)
    for axes, (measure, label) in zip(figure.subplots(1, len(DRAWN)), DRAWN.items(), strict=True):
        axes.axhline(0, color=GREY, lw=0.8)
        bought = {
            way: [
                case.less(DATASET_PRIOR, measure)
                for case in learned
                if case.where["refined_by"] == way.label
            ]
            for way in WAYS
        }
        plots.draw_lines(axes, bought, range(len(BUDGETS)), WIDTH)
        axes.set_xticks(range(len(BUDGETS)), labels=[str(k) for k in BUDGETS])
        axes.set(xlabel="candidates K", ylabel=label)
    return plots.with_legend(
        figure,
        f"{DIFFUSION.label} less {DATASET_PRIOR.label} (Δ) at the same K, by what both are refined "
        "by: means of the paired differences, with 95 % intervals.",
        columns=len(WAYS),
    )
