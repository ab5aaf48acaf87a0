"""Table 3: the random multi-step protocol again, for three static frictions."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np
import pandas as pd

from app.evaluation import paper
from app.evaluation.cells import mean_and_spread, with_interval
from app.evaluation.comparison import per_unit, rows_of
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    DIFFUSION,
    ENTRANTS,
    PAPER_DIFFUSION,
    PAPER_ENTRANTS,
    REFINED_PRIOR,
)
from app.evaluation.looks import LOOKS
from app.evaluation.plots import draw_intervals
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Claim, Picture, Section, Table
from app.evaluation.statistics import (
    Interval,
    interval,
    paired_difference,
)
from app.evaluation.suite import Answered, Suite
from app.evaluation.suites.multistep_random import sequence_questions
from app.evaluation.tables import statistics_table, times_table
from app.figures.style import PAGE_INCHES, new_figure
from app.planning.plant.system import System

NOMINAL = System()
FRICTIONS = (0.6, 0.7, 0.8)
"""f_s, m/s^2."""
DODGE = 0.05
"""Width over which a figure spreads the entrants about each f_s, m/s^2."""
LINEAR_BELOW = 1e-2
"""Errors below which the figure's axis is linear, down to zero, m."""


@dataclass(frozen=True)
class FrictionSensitivity(Suite):
    """The paper's sensitivity to static friction, with all methods."""

    name: ClassVar[str] = "friction-sensitivity"
    purpose: ClassVar[str] = "Table 3: the random sequences for f_s = 0.6, 0.7, 0.8, K = 128"

    @property
    def num_candidates(self) -> int:
        """K."""
        return 16 if self.quick else 128

    @property
    def size(self) -> tuple[int, int]:
        """Return how many sequences, and how many runs of each."""
        return (3, 1) if self.quick else (30, 5)

    @property
    def entrants(self) -> tuple[Entrant, ...]:
        """Who takes part."""
        return (*PAPER_ENTRANTS, DIFFUSION, REFINED_PRIOR) if self.quick else ENTRANTS

    def questions(self) -> Iterator[Question]:
        for friction, entrant in product(FRICTIONS, self.entrants):
            system = replace(NOMINAL, static_friction=friction)
            yield from sequence_questions(
                self.seed,
                self.size,
                entrant,
                self.num_candidates,
                # Unsaid where it is nominal: these are questions of multistep-random.
                None if system == NOMINAL else system,
                static_friction=friction,
            )

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        sequences, runs = self.size
        return Section(
            title="Sensitivity to static friction (Table 3)",
            introduction=(
                f"The random multi-step references again, with K = {self.num_candidates}, for "
                f"static frictions f_s of {', '.join(map(str, FRICTIONS))} m/s²; the other "
                "parameters of the plant stay, and Action Diffusion has a model of its own, "
                f"trained from scratch, for each f_s. {sequences} sequences, {runs} runs of each, "
                "and the same sequences and seeds for every f_s. The floor is what no plan can go "
                "below, from where each segment of the method's own plan starts."
            ),
            tables=(
                _errors(data, self.entrants),
                statistics_table(
                    data, self.name, "mean_end_error", self.entrants, "static_friction", FRICTIONS
                ),
                times_table(
                    data,
                    self.name,
                    "a sequence of three plans",
                    self.entrants,
                    "static_friction",
                    FRICTIONS,
                ),
            ),
            pictures=(_picture(data, self.entrants),),
            claims=(_claim(data),),
        )


def _errors(data: pd.DataFrame, entrants: tuple[Entrant, ...]) -> Table:
    rows = []
    for entrant in entrants:
        row = [entrant.label]
        for friction in FRICTIONS:
            of = rows_of(data, entrant, static_friction=friction)
            row += [
                mean_and_spread(of.mean_end_error, 3),
                paper.MEAN_END_ERROR_BY_FRICTION.get((entrant, friction), ""),
                f"{of.mean_end_floor.mean():.3f}",
            ]
        rows.append(row)
    return Table(
        "friction-sensitivity",
        "Mean end error: mean ± standard deviation (m), the paper's and the floor beside; lower is "
        "better.",
        (
            "Method",
            *(heading for fs in FRICTIONS for heading in (f"f_s = {fs}", "paper", "Floor")),
        ),
        rows,
    )


def _picture(data: pd.DataFrame, entrants: tuple[Entrant, ...]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.0)
    axes = figure.subplots()
    shifts = np.linspace(-DODGE / 2, DODGE / 2, len(entrants))
    for entrant, shift in zip(entrants, shifts, strict=True):
        found = [
            interval(per_unit(data, entrant, "mean_end_error", static_friction=friction))
            for friction in FRICTIONS
        ]
        draw_intervals(axes, LOOKS[entrant], entrant.label, np.add(FRICTIONS, shift), found)
    axes.set_xticks(FRICTIONS)
    axes.set_xlabel("static friction $f_s$ (m/s²)")
    axes.set_ylabel("mean end error (m)")
    axes.set_yscale("symlog", linthresh=LINEAR_BELOW)
    axes.set_ylim(-LINEAR_BELOW / 10, 1)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper")
    return Picture(
        "friction-sensitivity",
        "Mean end error for three static frictions: means over the sequences and runs, with 95 % "
        "intervals; the methods stand side by side about each value. The axis is linear below a "
        "centimetre.",
        figure,
    )


def _claim(data: pd.DataFrame) -> Claim:
    leads = {
        other: [_lead(data, PAPER_DIFFUSION, other, friction) for friction in FRICTIONS]
        for other in (CEM, DATASET_PRIOR)
    }

    def shown(of: list[Interval]) -> str:
        return ", ".join(
            f"{with_interval(lead, 3, '+')} m at f_s = {friction}"
            for friction, lead in zip(FRICTIONS, of, strict=True)
        )

    return Claim(
        "Action Diffusion has the lowest mean end error of the paper's three "
        "methods for all three f_s.",
        all(lead.high < 0 for of in leads.values() for lead in of),
        " ".join(
            f"Action Diffusion less {other.label}: {shown(of)}." for other, of in leads.items()
        ),
    )


def _lead(data: pd.DataFrame, entrant: Entrant, other: Entrant, friction: float) -> Interval:
    own, others = (
        per_unit(data, of, "mean_end_error", static_friction=friction) for of in (entrant, other)
    )
    return paired_difference(own, others)
