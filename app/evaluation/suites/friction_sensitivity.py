"""Table 3: the random multi-step protocol again, for three static frictions."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import pandas as pd

from app.evaluation import grid, paper
from app.evaluation.case import Case, cases_of
from app.evaluation.claims import lead_over, lower_claim
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    DIFFUSION,
    PAPER_DIFFUSION,
    PAPER_ENTRANTS,
    REFINED_PRIOR,
)
from app.evaluation.plots import draw_legend, draw_lines, entrant_lines
from app.evaluation.question import Question
from app.evaluation.section import Claim, Picture, Section
from app.evaluation.suite import Answered, Size, Suite
from app.evaluation.tasks import Task, sequence_tasks
from app.figures.style import PAGE_INCHES, new_figure
from app.planning.plant.system import System

NOMINAL = System()
FRICTIONS = (0.6, 0.7, 0.8)
"""f_s, m/s^2."""
ERROR = "mean_end_error"
WIDTH = 0.05
"""Over which a figure spreads the entrants about each f_s, m/s^2."""
LINEAR_BELOW = 1e-2
"""Errors below which the figure's axis is linear, down to zero, m."""


class FrictionSensitivity(Suite):
    """The paper's sensitivity to static friction, with all methods."""

    name = "friction-sensitivity"
    purpose = "Table 3: the random sequences for f_s = 0.6, 0.7, 0.8, K = 128"
    FULL = Size(budgets=(128,), tasks=30, runs=5)
    QUICK = Size(budgets=(16,), tasks=3, entrants=(*PAPER_ENTRANTS, DIFFUSION, REFINED_PRIOR))

    def tasks(self) -> list[Task]:
        return sequence_tasks(self.size.tasks, self.seed)

    def questions(self) -> Iterator[Question]:
        (k,) = self.size.budgets
        for friction, entrant in product(FRICTIONS, self.size.entrants):
            system = replace(NOMINAL, static_friction=friction)
            # Unsaid where it is nominal: these are questions of multistep-random.
            asked = entrant if system == NOMINAL else entrant.asking(system=system)
            yield from self.ask(asked, k, static_friction=friction)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        size = self.size
        cases = cases_of(data, size.entrants, static_friction=FRICTIONS)
        return Section(
            title="Sensitivity to static friction (Table 3)",
            introduction=(
                f"The random multi-step references again, with K = {size.budgets[0]}, for static "
                f"frictions f_s of {', '.join(map(str, FRICTIONS))} m/s²; the other parameters of "
                "the plant stay, and Action Diffusion has a model of its own, trained from "
                f"scratch, for each f_s. {size.tasks} sequences, {size.runs} runs of each, and the "
                "same sequences and seeds for every f_s. The floor is what no plan can go below, "
                "from where each segment of the method's own plan starts."
            ),
            tables=(
                grid.of_cases(
                    self.name,
                    "Mean end error: mean ± standard deviation (m), the paper's and the floor "
                    "beside; lower is better.",
                    cases_of(data, size.entrants),
                    *(column for friction in FRICTIONS for column in _columns(friction)),
                ),
                grid.statistics(self.name, cases, ERROR),
                grid.times(self.name, cases, "a sequence of three plans"),
            ),
            pictures=(_picture(cases),),
            claims=(_claim(data),),
        )


def _columns(friction: float) -> tuple[grid.Column[Case], ...]:
    """Show what was found for a friction, and what the paper prints."""
    printed = paper.MEAN_END_ERROR_BY_FRICTION
    return (
        grid.spread(f"f_s = {friction}", ERROR, 3, static_friction=friction),
        grid.Column("paper", lambda case: printed.get((case.entrant, friction), "")),
        grid.mean("Floor", "mean_end_floor", 3, static_friction=friction),
    )


def _picture(cases: Sequence[Case]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.0)
    axes = figure.subplots()
    draw_lines(axes, entrant_lines(cases, ERROR), FRICTIONS, WIDTH)
    axes.set(xlabel="static friction $f_s$ (m/s²)", ylabel="mean end error (m)", xticks=FRICTIONS)
    axes.set_yscale("symlog", linthresh=LINEAR_BELOW)
    axes.set_ylim(-LINEAR_BELOW / 10, 1)
    draw_legend(figure, "outside right upper")
    return Picture(
        "friction-sensitivity",
        "Mean end error for three static frictions: means over the sequences and runs, with 95 % "
        "intervals; the methods stand side by side about each value. The axis is linear below a "
        "centimetre.",
        figure,
    )


def _claim(data: pd.DataFrame) -> Claim:
    learned = cases_of(data, [PAPER_DIFFUSION], static_friction=FRICTIONS)
    return lower_claim(
        "Action Diffusion has the lowest mean end error of the paper's three methods for all three "
        "f_s.",
        *(lead_over(other, learned, ERROR) for other in (CEM, DATASET_PRIOR)),
    )
