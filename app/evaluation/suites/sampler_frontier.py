"""Error against network evaluations, for samplers of the learned model: paired, on the same tasks.

The tasks are the random multi-step ones; the paper's setting is what the others are compared with.
"""

from collections.abc import Iterator
from dataclasses import asdict
from itertools import product

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from app.evaluation import grid
from app.evaluation.case import Case
from app.evaluation.cells import with_interval
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.plots import draw_legend
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Picture, Section
from app.evaluation.suite import Answered, Size, Suite
from app.evaluation.tasks import Task, sequence_tasks
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
ERROR = "mean_end_error"
MARGIN = 0.005
"""A setting is not inferior if its mean end error is, at 95 %, at most this much above (m)."""

SOLVERS = {"ddim": ("DDIM", BLUE), "dpm_solver": ("DPM-Solver++", RED)}
"""Name and colour."""
GUIDANCE = {1.0: ("o", ":"), 1.5: ("^", "--"), 2.0: ("s", "-")}
"""Marker and line, by scale."""
EVALUATIONS = (1, 2, 5, 10, 20, 50, 100)
"""Ticks."""


class SamplerFrontier(Suite):
    """How few network evaluations do as well as the paper's hundred."""

    name = "sampler-frontier"
    purpose = "Error against network evaluations: samplers of the learned model"
    FULL = Size(budgets=(1, 16, 128), tasks=50)
    QUICK = Size(budgets=(1, 4), tasks=3)

    def tasks(self) -> list[Task]:
        return sequence_tasks(self.size.tasks, self.seed)

    def questions(self) -> Iterator[Question]:
        for k, setting in product(self.size.budgets, SETTINGS):
            _, steps, scale = setting.settings
            yield from self.ask(entrant_of(setting), k, steps=steps, guidance_scale=scale)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        solver, steps, scale = ActionDiffusion().settings
        budgets = self.size.budgets
        return Section(
            title="Error against network evaluations",
            introduction=(
                f"Samplers of the learned model on the same {self.size.tasks} random multi-step "
                "sequences. The paper samples with 50 DDIM steps of two network evaluations each, "
                "and guidance scale s = 2; without guidance (s = 1) a step takes one evaluation. "
                f"The service's default is {SOLVERS[solver][0]} with {steps} steps, "
                f"s = {scale:g}."
            ),
            tables=(
                grid.table(
                    self.name,
                    "Mean end error (m), and in parentheses what it is more than that of the "
                    "paper's setting, with its 95 % bootstrap interval over the sequences, paired; "
                    f"an asterisk marks what may be more than {MARGIN:g} m worse.",
                    SETTINGS,
                    (
                        grid.Column("Sampler", _name),
                        grid.Column("Steps", lambda setting: str(setting.settings.steps)),
                        grid.Column("s", lambda setting: f"{setting.settings.guidance_scale:g}"),
                        grid.Column("Evaluations", lambda setting: str(_evaluations(setting))),
                        *(_error_column(data, k) for k in budgets),
                    ),
                ),
            ),
            pictures=(_picture(data, budgets),),
        )


def entrant_of(setting: ActionDiffusion) -> Entrant:
    """Return a sampler as it takes part; the paper's asks what it asks in the other suites."""
    if setting == PAPER:
        return PAPER_DIFFUSION
    solver, steps, scale = setting.settings
    label = f"{SOLVERS[solver][0]}, {steps} steps, s = {scale:g}"
    return Entrant(label, {"method": asdict(setting)})


def _name(setting: ActionDiffusion) -> str:
    return SOLVERS[setting.settings.solver][0] + " (paper)" * (setting == PAPER)


def _evaluations(setting: ActionDiffusion) -> int:
    """Return how often the network is evaluated for a plan."""
    return setting.cost(1).network_evaluations


def _case(data: pd.DataFrame, setting: ActionDiffusion, k: int) -> Case:
    return Case(data, entrant_of(setting), {"num_candidates": k})


def _error_column(data: pd.DataFrame, k: int) -> grid.Column[ActionDiffusion]:
    def error(setting: ActionDiffusion) -> str:
        case = _case(data, setting, k)
        mean = f"{case.per_unit(ERROR).mean():.3f}"
        if setting == PAPER:
            return mean
        more = case.less(case.with_entrant(PAPER_DIFFUSION), ERROR)
        return f"{mean}{'*' * (more.high > MARGIN)} ({with_interval(more, 3, '+')})"

    return grid.Column(f"K = {k}", error)


def _picture(data: pd.DataFrame, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(PAGE_INCHES, 2.8)
    panels = figure.subplots(1, len(budgets), sharey=True)
    for axes, k in zip(panels, budgets, strict=True):
        errors = {setting: _case(data, setting, k).mean(ERROR) for setting in SETTINGS}
        _draw_frontier(axes, errors)
        axes.set_title(f"K = {k}")
    panels[0].set_ylabel("mean end error (m)")
    draw_legend(figure, "outside upper center", columns=4)
    return Picture(
        "sampler-frontier",
        "Mean end error over the sequences against the network evaluations of a plan; s is the "
        "guidance scale, the grey line the error of the paper's setting.",
        figure,
    )


def _draw_frontier(axes: Axes, errors: dict[ActionDiffusion, float]) -> None:
    """Draw a line for each solver and guidance scale, and the paper's setting as a star."""
    for (scale, (marker, line)), (solver, (name, color)) in product(
        GUIDANCE.items(), SOLVERS.items()
    ):
        on_line = sorted(
            (_evaluations(setting), error)
            for setting, error in errors.items()
            if (setting.settings.solver, setting.settings.guidance_scale) == (solver, scale)
        )
        axes.plot(
            *zip(*on_line, strict=True), color=color, marker=marker, ls=line,
            label=f"{name}, s = {scale:g}",
        )  # fmt: skip
    axes.axhline(errors[PAPER], color=GREY, lw=0.8)
    axes.plot(
        _evaluations(PAPER), errors[PAPER], "*", color=BLACK, ms=9, label="the paper's setting"
    )
    axes.set(xlabel="network evaluations", xscale="log", yscale="log")
    axes.set_xticks(EVALUATIONS, labels=[str(number) for number in EVALUATIONS])
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
