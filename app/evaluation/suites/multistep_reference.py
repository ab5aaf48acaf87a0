"""Figure 4: one sequence of three targets, and what each method's runs make of it."""

from collections.abc import Iterable

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from app.evaluation import claims, grid
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of
from app.evaluation.entrants import CEM, DATASET_PRIOR, PAPER_DIFFUSION, REFINED_DIFFUSION
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Parts, Picture, Row, Size, Suite
from app.evaluation.tasks import one_task
from app.figures.plan import draw_controls, draw_stiction_band
from app.figures.style import BLACK, new_figure
from app.planning.plant.system import System

POSITIONS = (0.4, -0.4, 0.2)
"""Of the targets, m."""
COMPARED = (PAPER_DIFFUSION, DATASET_PRIOR, CEM, REFINED_DIFFUSION)
ERROR = "mean_end_error"
FLAT = 0.2
"""Almost flat are positions within a quarter of the reference's range (m)."""
DEVIATION = 0.1
"""A run deviates substantially if its mean end error exceeds this (m)."""
SEVERAL = 2
"""Runs."""
THIN, THICK, FAINT = 0.5, 1.2, 0.5
"""Line widths of the runs and of their mean, and the runs' opacity."""


class MultistepReference(Suite):
    """Figure 4: the targets 0.4, -0.4, 0.2 m, 5 runs, K = 16 and 512."""

    name = "multistep-reference"
    title = "A multi-step reference (Figure 4)"
    draw_tasks = staticmethod(
        one_task(targets=[(position, 0.0) for position in POSITIONS], include=["states"])
    )
    FULL = Size(budgets=(16, 512), runs=5, entrants=COMPARED)
    QUICK = Size(budgets=(16, 32), runs=2, entrants=COMPARED)
    trajectories = True

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Add the range of the positions to the measures."""
        (row,) = super().rows(question, answer)
        return [{**row, "position_range": np.ptp(_positions([answer])).item()}]

    def report(self, data: pd.DataFrame) -> Parts:
        cases = cases_of(data, COMPARED, num_candidates=self.size.budgets)
        yield (
            f"From rest to the targets {', '.join(f'{each:g}' for each in POSITIONS)} m, one after "
            f"the other and each at rest; {self.size.runs} runs of each method and K. The spread "
            "of the runs is the standard deviation of the position across them, averaged over time."
        )
        yield grid.of_cases(
            "Mean ± standard deviation over the runs; the floor is what no plan can go below from "
            "where each segment of the method's own plan starts.",
            cases,
            grid.spread("Mean end error (m)", ERROR, 3),
            grid.mean("Floor (m)", "mean_end_floor", 3),
            grid.spread("Stuck steps", "stuck_steps", 1),
            grid.spread("Range of positions (m)", "position_range", 3),
            grid.Column("Spread of the runs (m)", lambda case: f"{_spread_of_runs(case):.3f}"),
        )
        yield grid.times(cases, f"a sequence of {len(POSITIONS)} plans")
        yield _picture(cases)
        yield from _claims(data, *self.size.budgets)


def _positions(answers: Iterable[Answer]) -> NDArray[np.float64]:
    """Return positions over time, (runs, 3H+1), in m."""
    return np.array([answer.content["states"] for answer in answers])[:, :, 0]


def _spread_of_runs(case: Case) -> float:
    """Return the standard deviation of the position across runs, averaged over time, in m."""
    return float(_positions(case.rows.answer).std(axis=0).mean())


def _picture(cases: list[Case]) -> Picture:
    rows = len(cases) // len(COMPARED)
    figure = new_figure(3.2 * rows)
    panels = figure.subplots(2 * rows, len(COMPARED), sharex=True, sharey="row")
    # Positions above controls for each K, and a column for each method: as the cases come.
    for number, case in enumerate(cases):
        row, place = divmod(number, len(COMPARED))
        position_axes, control_axes = panels[2 * row : 2 * row + 2, place]
        _draw(position_axes, control_axes, case)
        if place == 0:
            position_axes.set_ylabel(f"{case.place}\nposition (m)")
            control_axes.set_ylabel(f"{case.place}\ncontrol (m/s²)")
    for place, entrant in enumerate(COMPARED):
        panels[0, place].set_title(entrant.label)
        panels[-1, place].set_xlabel("time (s)")
    return Picture(
        "Positions and controls over time: each run thin, the mean of the runs thick, the "
        "reference dashed. Inside the grey band a push is too weak to start the mass.",
        figure,
    )


def _draw(position_axes: Axes, control_axes: Axes, case: Case) -> None:
    runs, color = list(case.rows.answer), case.entrant.look.color
    positions = _positions(runs)
    controls = np.array([answer.content["controls"] for answer in runs])
    plant = System(**runs[0].content["system"])
    times = plant.time_step * np.arange(positions.shape[1])
    edges = np.linspace(0, times[-1], len(POSITIONS) + 1)
    position_axes.plot(times, positions.T, color=color, lw=THIN, alpha=FAINT)
    position_axes.plot(times, positions.mean(axis=0), color=color, lw=THICK)
    position_axes.stairs(POSITIONS, edges, baseline=None, color=BLACK, ls="--", lw=0.8)
    draw_stiction_band(control_axes, plant)
    draw_controls(control_axes, times, controls, color, THIN, FAINT)
    draw_controls(control_axes, times, controls.mean(axis=0, keepdims=True), color, THICK)
    control_axes.set_xlim(0, times[-1])


def _claims(data: pd.DataFrame, low: int, high: int) -> Parts:
    learned_low, cem_low, learned_high, cem_high = cases_of(
        data, [PAPER_DIFFUSION, CEM], num_candidates=[low, high]
    )
    learned, cem, cem_at_high = (case.values(ERROR) for case in (learned_low, cem_low, cem_high))
    ranges = cem_low.values("position_range")
    deviating = int(np.sum(cem_at_high > DEVIATION))
    yield Claim(
        f"With K = {low}, Action Diffusion follows the intended sequence more consistently.",
        bool(np.all(learned < cem)),
        "More consistently: nearer than CEM in every run. Mean end errors of the runs: "
        f"{PAPER_DIFFUSION.label} {learned.min():.3f} to {learned.max():.3f} m, "
        f"{CEM.label} {cem.min():.3f} to {cem.max():.3f} m.",
    )
    yield Claim(
        f"With K = {low}, CEM remains almost flat.",
        bool(ranges.max() < FLAT),
        f"Almost flat: in every run positions within {FLAT:g} m, a quarter of the reference's "
        f"range. CEM's runs range over {ranges.min():.3f} to {ranges.max():.3f} m.",
    )
    yield Claim(
        f"With K = {high}, CEM improves on average, but several runs deviate substantially.",
        bool(cem_at_high.mean() < cem.mean()) and deviating >= SEVERAL,
        f"CEM's mean end error is {cem.mean():.3f} m at K = {low} and "
        f"{cem_at_high.mean():.3f} m at K = {high}, where it exceeds {DEVIATION:g} m in "
        f"{deviating} of {len(cem_at_high)} runs (several are at least {SEVERAL}).",
    )
    yield claims.lowest(
        f"With K = {high}, Action Diffusion is more consistent across runs than CEM.",
        PAPER_DIFFUSION,
        {
            "Spread of the runs": {
                case.entrant: _spread_of_runs(case) for case in (learned_high, cem_high)
            }
        },
        "{:.3f} m",
    )
