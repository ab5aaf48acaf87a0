"""Table 3: the random multi-step protocol again, for three static frictions."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import pandas as pd

from app.evaluation import claims, entrants, grid, paper, plots
from app.evaluation.case import Case, cases_of
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Parts, Picture, Size, Suite
from app.evaluation.tasks import sequence_tasks
from app.figures.style import BLACK, Look, new_figure
from app.planning.plant.system import System

NOMINAL = System()
FRICTIONS = (0.6, 0.7, 0.8)
"""f_s, m/s^2."""
ERROR = "mean_end_error"
OWN_MODEL = Entrant(
    "Action Diffusion (a model for each f_s)", entrants.DIFFUSION.fields, Look(BLACK, "h", "-.")
)
"""With the paper's models, and the sampler that the service chooses for them."""
TRAINED_FOR_EACH = (entrants.PAPER_DIFFUSION, OWN_MODEL)
WIDTH = 0.05
"""Over which a figure spreads the entrants about each f_s, m/s^2."""
LINEAR_BELOW = 1e-2
"""Errors below which the figure's axis is linear, down to zero, m."""


class FrictionSensitivity(Suite):
    """Table 3: the random sequences for f_s = 0.6, 0.7, 0.8, K = 128."""

    name = "friction-sensitivity"
    title = "Sensitivity to static friction (Table 3)"
    draw_tasks = staticmethod(sequence_tasks)
    FULL = Size(budgets=(128,), tasks=30, runs=5, entrants=(*entrants.ENTRANTS, OWN_MODEL))
    QUICK = Size(
        budgets=(16,),
        tasks=3,
        entrants=(
            *entrants.PAPER_ENTRANTS,
            entrants.DIFFUSION,
            entrants.REFINED_PRIOR,
            OWN_MODEL,
        ),
    )

    def questions(self) -> Iterator[Question]:
        (k,) = self.size.budgets
        for friction, entrant in product(FRICTIONS, self.size.entrants):
            system = replace(NOMINAL, static_friction=friction)
            # Unsaid where it is nominal: these are questions of multistep-random.
            asked = entrant if system == NOMINAL else entrant.asking(system=system)
            if entrant in TRAINED_FOR_EACH:
                asked = asked.asking(model=f"dry-friction-fs{friction}")
            yield from self.ask(asked, k, static_friction=friction)

    def report(self, data: pd.DataFrame) -> Parts:
        size = self.size
        cases = cases_of(data, size.entrants, static_friction=FRICTIONS)
        yield (
            f"The random multi-step references again, with K = {size.budgets[0]}, for static "
            f"frictions f_s of {', '.join(map(str, FRICTIONS))} m/s²; the other parameters of the "
            f"plant stay. {entrants.DIFFUSION.label} has one model for all of them, "
            f"{' and '.join(each.label for each in TRAINED_FOR_EACH)} one trained from scratch for "
            f"each f_s. {size.tasks} sequences, {size.runs} runs of each, and "
            "the same sequences and seeds for every f_s. The floor is what no plan can go below, "
            "from where each segment of the method's own plan starts."
        )
        yield grid.of_cases(
            "Mean end error: mean ± standard deviation (m), the paper's and the floor beside; "
            "lower is better.",
            cases_of(data, size.entrants),
            *(column for friction in FRICTIONS for column in _columns(friction)),
        )
        yield grid.statistics(cases, ERROR)
        yield grid.times(cases, "a sequence of three plans")
        yield _picture(cases)
        learned = [case for case in cases if case.entrant == entrants.PAPER_DIFFUSION]
        yield claims.lower(
            "Action Diffusion has the lowest mean end error of the paper's three methods for all "
            "three f_s.",
            *(
                claims.lead_over(other, learned, ERROR)
                for other in (entrants.CEM, entrants.DATASET_PRIOR)
            ),
        )
        yield claims.lower(
            "One model for every machine ends nearer, for each f_s, than the three that were "
            "trained from scratch for it (beyond the paper).",
            *(
                claims.lead_over(
                    other, [case for case in cases if case.entrant == entrants.DIFFUSION], ERROR
                )
                for other in TRAINED_FOR_EACH
            ),
        )


def _columns(friction: float) -> tuple[grid.Column[Case], ...]:
    """Show what was found for a friction, and what the paper prints."""
    printed = paper.MEAN_END_ERROR_BY_FRICTION
    return (
        grid.spread(f"f_s = {friction}", ERROR, 3, static_friction=friction),
        grid.Column("paper", lambda case: printed.get(case.entrant, {}).get(friction, "")),
        grid.mean("Floor", "mean_end_floor", 3, static_friction=friction),
    )


def _picture(cases: list[Case]) -> Picture:
    figure = new_figure(3.0)
    axes = figure.subplots()
    plots.draw_lines(axes, plots.entrant_lines(cases, ERROR), FRICTIONS, WIDTH)
    axes.set(xlabel="static friction $f_s$ (m/s²)", ylabel="mean end error (m)", xticks=FRICTIONS)
    axes.set_yscale("symlog", linthresh=LINEAR_BELOW)
    axes.set_ylim(-LINEAR_BELOW / 10, 1)
    return plots.with_legend(
        figure,
        "Mean end error for three static frictions: means over the sequences and runs, with 95 % "
        "intervals; the methods stand side by side about each value. The axis is linear below a "
        "centimetre.",
    )
