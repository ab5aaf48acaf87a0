"""Figure 4: one sequence of three targets, and what each method's runs make of it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar, TypeAlias

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from app.evaluation.answer_log import Answer
from app.evaluation.cells import mean_and_spread
from app.evaluation.comparison import column, rows_of
from app.evaluation.entrants import CEM, DATASET_PRIOR, PAPER_DIFFUSION, REFINED_DIFFUSION
from app.evaluation.looks import LOOKS
from app.evaluation.question import Entrant, Question, question_to
from app.evaluation.section import Claim, Picture, Section, Table
from app.evaluation.suite import Answered, Row, Suite
from app.evaluation.tables import times_table
from app.evaluation.tasks import REST
from app.figures.plan import draw_controls, draw_stiction_band
from app.figures.style import BLACK, PAGE_INCHES, new_figure
from app.planning.plant.system import System
from app.wire.requests import MultistepPlanRequest

TARGETS = ((0.4, 0.0), (-0.4, 0.0), (0.2, 0.0))
COMPARED = (PAPER_DIFFUSION, DATASET_PRIOR, CEM, REFINED_DIFFUSION)
FLAT = 0.2
"""Almost flat are positions within a quarter of the reference's range (m)."""
DEVIATION = 0.1
"""A run deviates substantially if its mean end error exceeds this (m)."""
SEVERAL = 2
"""Runs."""
THIN, THICK, FAINT = 0.5, 1.2, 0.5
"""Line widths of the runs and of their mean, and the runs' opacity."""

Plans: TypeAlias = Mapping[tuple[int, Entrant], list[Answer]]
"""The runs' answers, by K and entrant."""


@dataclass(frozen=True)
class MultistepReference(Suite):
    """The paper's multi-step reference, run by run."""

    name: ClassVar[str] = "multistep-reference"
    purpose: ClassVar[str] = "Figure 4: the targets 0.4, -0.4, 0.2 m, 5 runs, K = 16 and 512"

    @property
    def budgets(self) -> tuple[int, int]:
        """K."""
        return (16, 32) if self.quick else (16, 512)

    @property
    def runs(self) -> int:
        """How many runs of each method and K."""
        return 2 if self.quick else 5

    def questions(self) -> Iterator[Question]:
        fields = {"initial_state": REST, "targets": TARGETS, "include": ["states"]}
        for k, entrant, run in product(self.budgets, COMPARED, range(self.runs)):
            yield question_to(
                entrant, MultistepPlanRequest, fields, k, self.seed, 0, run, trajectories=True
            )

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Add the range of the positions to the measures."""
        (row,) = super().rows(question, answer)
        return [{**row, "position_range": np.ptp(_positions([answer])).item()}]

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        plans = {
            (k, entrant): [
                answer
                for question, answer in answered
                if (question.labels["num_candidates"], question.labels["entrant"])
                == (k, entrant.label)
            ]
            for k, entrant in product(self.budgets, COMPARED)
        }
        targets = ", ".join(f"{position:g}" for position, _ in TARGETS)
        return Section(
            title="A multi-step reference (Figure 4)",
            introduction=(
                f"From rest to the targets {targets} m, one after the other and each at rest; "
                f"{self.runs} runs of each method and K. The spread of the runs is the standard "
                "deviation of the position across them, averaged over time."
            ),
            tables=(
                _errors(data, plans),
                times_table(
                    data,
                    self.name,
                    f"a sequence of {len(TARGETS)} plans",
                    COMPARED,
                    "num_candidates",
                    self.budgets,
                ),
            ),
            pictures=(_picture(plans),),
            claims=_claims(data, plans),
        )


def _positions(runs: Sequence[Answer]) -> NDArray[np.float64]:
    """Return positions over time, (runs, 3H+1), in m."""
    return np.array([answer.content["states"] for answer in runs])[:, :, 0]


def _spread_of_runs(runs: Sequence[Answer]) -> float:
    """Return the standard deviation of the position across runs, averaged over time, in m."""
    return float(_positions(runs).std(axis=0).mean())


def _errors(data: pd.DataFrame, plans: Plans) -> Table:
    rows = []
    for (k, entrant), runs in plans.items():
        of = rows_of(data, entrant, num_candidates=k)
        rows.append(
            (
                entrant.label,
                str(k),
                mean_and_spread(of.mean_end_error, 3),
                f"{of.mean_end_floor.mean():.3f}",
                mean_and_spread(of.stuck_steps, 1),
                mean_and_spread(of.position_range, 3),
                f"{_spread_of_runs(runs):.3f}",
            )
        )
    return Table(
        "multistep-reference",
        "Mean ± standard deviation over the runs; the floor is what no plan can go below from "
        "where each segment of the method's own plan starts.",
        ("Method", "K", "Mean end error (m)", "Floor (m)", "Stuck steps", "Range of positions (m)",
         "Spread of the runs (m)"),
        rows,
    )  # fmt: skip


def _picture(plans: Plans) -> Picture:
    budgets = list(dict.fromkeys(k for k, _ in plans))
    figure = new_figure(PAGE_INCHES, 3.2 * len(budgets))
    panels = figure.subplots(2 * len(budgets), len(COMPARED), sharex=True, sharey="row")
    for (row, k), (place, entrant) in product(enumerate(budgets), enumerate(COMPARED)):
        position_axes, control_axes = panels[2 * row : 2 * row + 2, place]
        _draw(position_axes, control_axes, plans[k, entrant], LOOKS[entrant].color)
        if place == 0:
            position_axes.set_ylabel(f"K = {k}\nposition (m)")
            control_axes.set_ylabel(f"K = {k}\ncontrol (m/s²)")
    for place, entrant in enumerate(COMPARED):
        panels[0, place].set_title(entrant.label)
        panels[-1, place].set_xlabel("time (s)")
    return Picture(
        "multistep-reference",
        "Positions and controls over time: each run thin, the mean of the runs thick, the "
        "reference dashed. Inside the grey band a push is too weak to start the mass.",
        figure,
    )


def _draw(position_axes: Axes, control_axes: Axes, runs: Sequence[Answer], color: str) -> None:
    positions = _positions(runs)
    controls = np.array([answer.content["controls"] for answer in runs])
    plant = System(**runs[0].content["system"])
    times = plant.time_step * np.arange(positions.shape[1])
    edges = np.linspace(0, times[-1], len(TARGETS) + 1)
    position_axes.plot(times, positions.T, color=color, lw=THIN, alpha=FAINT)
    position_axes.plot(times, positions.mean(axis=0), color=color, lw=THICK)
    position_axes.stairs(
        [position for position, _ in TARGETS], edges, baseline=None, color=BLACK, ls="--", lw=0.8
    )
    draw_stiction_band(control_axes, plant)
    draw_controls(control_axes, times, controls, color, THIN, FAINT)
    draw_controls(control_axes, times, controls.mean(axis=0, keepdims=True), color, THICK)
    control_axes.set_xlim(0, times[-1])


def _claims(data: pd.DataFrame, plans: Plans) -> tuple[Claim, ...]:
    low, *_, high = (k for k, _ in plans)

    def errors(entrant: Entrant, k: int) -> NDArray[np.float64]:
        return column(data, entrant, "mean_end_error", num_candidates=k)

    def extent(entrant: Entrant, k: int) -> str:
        found = errors(entrant, k)
        return f"{entrant.label} {found.min():.3f} to {found.max():.3f} m"

    ranges = column(data, CEM, "position_range", num_candidates=low)
    deviating = int(np.sum(errors(CEM, high) > DEVIATION))
    apart = {entrant: _spread_of_runs(plans[high, entrant]) for entrant in (PAPER_DIFFUSION, CEM)}
    return (
        Claim(
            f"With K = {low}, Action Diffusion follows the intended sequence more consistently.",
            bool(np.all(errors(PAPER_DIFFUSION, low) < errors(CEM, low))),
            "More consistently: nearer than CEM in every run. Mean end errors of the runs: "
            f"{extent(PAPER_DIFFUSION, low)}, {extent(CEM, low)}.",
        ),
        Claim(
            f"With K = {low}, CEM remains almost flat.",
            bool(ranges.max() < FLAT),
            f"Almost flat: in every run positions within {FLAT:g} m, a quarter of the reference's "
            f"range. CEM's runs range over {ranges.min():.3f} to {ranges.max():.3f} m.",
        ),
        Claim(
            f"With K = {high}, CEM improves on average, but several runs deviate substantially.",
            bool(errors(CEM, high).mean() < errors(CEM, low).mean()) and deviating >= SEVERAL,
            f"CEM's mean end error is {errors(CEM, low).mean():.3f} m at K = {low} and "
            f"{errors(CEM, high).mean():.3f} m at K = {high}, where it exceeds {DEVIATION:g} m in "
            f"{deviating} of {len(errors(CEM, high))} runs (several are at least {SEVERAL}).",
        ),
        Claim(
            f"With K = {high}, Action Diffusion is more consistent across runs than CEM.",
            apart[PAPER_DIFFUSION] < apart[CEM],
            "Spread of the runs: "
            + ", ".join(f"{entrant.label} {value:.3f} m" for entrant, value in apart.items())
            + ".",
        ),
    )
