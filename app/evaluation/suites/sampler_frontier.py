"""Error against network evaluations, for samplers of the learned model: paired, on the same tasks.

The tasks are the random multi-step ones; the paper's setting is what the others are compared with.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from typing import ClassVar, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from app.evaluation.cells import with_interval
from app.evaluation.comparison import per_unit
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Picture, Section, Table
from app.evaluation.statistics import paired_difference
from app.evaluation.suite import Answered, Suite
from app.evaluation.suites.multistep_random import sequence_questions
from app.figures.style import BLACK, BLUE, GREY, PAGE_INCHES, RED, new_figure
from app.planning.methods import ActionDiffusion

PAPER = ActionDiffusion(sampler="paper")
SETTINGS = (
    PAPER,
    *(ActionDiffusion(sampler="ddim", steps=n, guidance_scale=s)
      for n, s in ((2, 1), (5, 1), (5, 1.5), (10, 1), (10, 1.5), (10, 2), (20, 2))),
    *(ActionDiffusion(sampler="dpm_solver", steps=n, guidance_scale=s)
      for n, s in ((1, 1), (2, 1), (4, 1), (2, 2), (3, 2), (4, 1.5), (4, 2), (6, 2), (10, 2))),
)  # fmt: skip
MARGIN = 0.005
"""A setting is not inferior if its mean end error is, at 95 %, at most this much above (m)."""

SOLVERS = {"ddim": ("DDIM", BLUE), "dpm_solver": ("DPM-Solver++", RED)}
"""Name and colour."""
GUIDANCE = {1.0: ("o", ":"), 1.5: ("^", "--"), 2.0: ("s", "-")}
"""Marker and line, by scale."""
EVALUATIONS = (1, 2, 5, 10, 20, 50, 100)
"""Ticks."""


@dataclass(frozen=True)
class SamplerFrontier(Suite):
    """How few network evaluations do as well as the paper's hundred."""

    name: ClassVar[str] = "sampler-frontier"
    purpose: ClassVar[str] = "Error against network evaluations: samplers of the learned model"

    @property
    def budgets(self) -> tuple[int, ...]:
        """K."""
        return (1, 4) if self.quick else (1, 16, 128)

    @property
    def size(self) -> tuple[int, int]:
        """Return how many sequences, and how many runs of each."""
        return (3 if self.quick else 50, 1)

    def questions(self) -> Iterator[Question]:
        for k, setting in product(self.budgets, SETTINGS):
            yield from sequence_questions(
                self.seed,
                self.size,
                entrant_of(setting),
                k,
                steps=setting.settings.steps,
                guidance_scale=setting.settings.guidance_scale,
            )

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        solver, steps, scale = ActionDiffusion().settings
        return Section(
            title="Error against network evaluations",
            introduction=(
                f"Samplers of the learned model on the same {self.size[0]} random multi-step "
                "sequences. The paper samples with 50 DDIM steps of two network evaluations each, "
                "and guidance scale s = 2; without guidance (s = 1) a step takes one evaluation. "
                f"The service's default is {SOLVERS[solver][0]} with {steps} steps, "
                f"s = {scale:g}."
            ),
            tables=(_errors(data, self.budgets),),
            pictures=(_picture(data, self.budgets),),
        )


def entrant_of(setting: ActionDiffusion) -> Entrant:
    """Return a sampler as it takes part; the paper's asks what it asks in the other suites."""
    if setting == PAPER:
        return PAPER_DIFFUSION
    solver, steps, scale = setting.settings
    label = f"{SOLVERS[solver][0]}, {steps} steps, s = {scale:g}"
    return Entrant(label, {"method": asdict(setting)})


class _Point(NamedTuple):
    evaluations: int
    """Of the network, for a plan."""
    error: float
    """Mean end error, m."""


def _errors_of(data: pd.DataFrame, setting: ActionDiffusion, k: int) -> NDArray[np.float64]:
    return per_unit(data, entrant_of(setting), "mean_end_error", num_candidates=k)


def _errors(data: pd.DataFrame, budgets: tuple[int, ...]) -> Table:
    rows = []
    for setting in SETTINGS:
        solver, steps, scale = setting.settings
        rows.append(
            (
                SOLVERS[solver][0] + " (paper)" * (setting == PAPER),
                str(steps),
                f"{scale:g}",
                str(_evaluations(setting)),
                *(_cell(data, setting, k) for k in budgets),
            )
        )
    return Table(
        "sampler-frontier",
        "Mean end error (m), and in parentheses what it is more than that of the paper's setting, "
        "with its 95 % bootstrap interval over the sequences, paired; an asterisk marks what may "
        f"be more than {MARGIN:g} m worse.",
        ("Sampler", "Steps", "s", "Evaluations", *(f"K = {k}" for k in budgets)),
        rows,
    )


def _cell(data: pd.DataFrame, setting: ActionDiffusion, k: int) -> str:
    errors = _errors_of(data, setting, k)
    if setting == PAPER:
        return f"{errors.mean():.3f}"
    difference = paired_difference(errors, _errors_of(data, PAPER, k))
    inferior = "*" if difference.high > MARGIN else ""
    return f"{errors.mean():.3f}{inferior} ({with_interval(difference, 3, '+')})"


def _picture(data: pd.DataFrame, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(PAGE_INCHES, 2.8)
    panels = figure.subplots(1, len(budgets), sharey=True)
    for axes, k in zip(panels, budgets, strict=True):
        points = {s: _Point(_evaluations(s), _errors_of(data, s, k).mean()) for s in SETTINGS}
        _draw_frontier(axes, points)
        axes.set_title(f"K = {k}")
    panels[0].set_ylabel("mean end error (m)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return Picture(
        "sampler-frontier",
        "Mean end error over the sequences against the network evaluations of a plan; s is the "
        "guidance scale, the grey line the error of the paper's setting.",
        figure,
    )


def _draw_frontier(axes: Axes, points: dict[ActionDiffusion, _Point]) -> None:
    """Draw a line for each solver and guidance scale, and the paper's setting as a star."""
    for (scale, (marker, line)), (solver, (name, color)) in product(
        GUIDANCE.items(), SOLVERS.items()
    ):
        on_line = sorted(
            point
            for setting, point in points.items()
            if (setting.settings.solver, setting.settings.guidance_scale) == (solver, scale)
        )
        axes.plot(
            *zip(*on_line, strict=True), color=color, marker=marker, ls=line,
            label=f"{name}, s = {scale:g}",
        )  # fmt: skip
    paper = points[PAPER]
    axes.axhline(paper.error, color=GREY, lw=0.8)
    axes.plot(*paper, "*", color=BLACK, ms=9, label="the paper's setting")
    axes.set_xscale("log")
    axes.set_xticks(EVALUATIONS, labels=[str(number) for number in EVALUATIONS])
    axes.set_xlabel("network evaluations")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _evaluations(setting: ActionDiffusion) -> int:
    return setting.cost(1).network_evaluations
