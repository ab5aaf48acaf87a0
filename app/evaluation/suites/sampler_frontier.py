"""Error against network evaluations, for samplers of the paper's model: paired, on the same tasks.

The tasks are the random multi-step ones; the paper's setting is what the others are compared with.
"""

from collections.abc import Iterator
from dataclasses import asdict
from itertools import product
from typing import TypeAlias

import pandas as pd
from matplotlib.ticker import LogLocator, NullFormatter

from app.evaluation import grid, plots
from app.evaluation.case import Case
from app.evaluation.entrants import PAPER_DIFFUSION, PAPER_MODEL
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Parts, Picture, Size, Suite
from app.evaluation.tasks import sequence_tasks
from app.figures.style import BLACK, BLUE, GREY, RED, Look, new_figure
from app.planning.methods import ActionDiffusion
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Sampler

PAPER = ActionDiffusion(sampler="paper")
SETTINGS = (
    PAPER,
    *(ActionDiffusion(sampler="ddim", steps=n, guidance_scale=s)
      for n, s in ((2, 1), (5, 1), (5, 1.5), (10, 1), (10, 1.5), (10, 2), (20, 2))),
    *(ActionDiffusion(sampler="dpm_solver", steps=n, guidance_scale=s)
      for n, s in ((1, 1), (2, 1), (4, 1), (2, 2), (3, 2), (4, 1.5), (4, 2), (6, 2), (10, 2))),
)  # fmt: skip
Cases: TypeAlias = dict[ActionDiffusion, Case]
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
    """Error against network evaluations: samplers of the learned model."""

    name = "sampler-frontier"
    title = "Error against network evaluations"
    draw_tasks = staticmethod(sequence_tasks)
    FULL = Size(budgets=(1, 16, 128), tasks=50)
    QUICK = Size(budgets=(1, 4), tasks=3)

    def questions(self) -> Iterator[Question]:
        for k, setting in product(self.size.budgets, SETTINGS):
            sampling = _settled(setting).settings
            steps, scale = sampling.steps, sampling.guidance_scale
            yield from self.ask(entrant_of(setting), k, steps=steps, guidance_scale=scale)

    def report(self, data: pd.DataFrame) -> Parts:
        cases = {setting: Case(data, entrant_of(setting), {}) for setting in SETTINGS}
        default = _settled(ActionDiffusion())
        yield (
            f"Samplers of the learned model on the same {self.size.tasks} random multi-step "
            "sequences. The paper samples with 50 DDIM steps of two network evaluations each, and "
            "guidance scale s = 2; without guidance (s = 1) a step takes one evaluation. The "
            f"default with this model is {SOLVERS[default.solver][0]} with "
            f"{default.settings.steps} steps, s = {default.settings.guidance_scale:g}."
        )
        yield grid.table(
            "Mean end error (m), and in parentheses what it is more than that of the paper's "
            "setting, with its 95 % bootstrap interval over the sequences, paired; an asterisk "
            f"marks what may be more than {MARGIN:g} m worse.",
            SETTINGS,
            (
                grid.Column("Sampler", _name),
                grid.Column("Steps", lambda setting: str(_settled(setting).settings.steps)),
                grid.Column("s", lambda setting: f"{_settled(setting).settings.guidance_scale:g}"),
                grid.Column("Evaluations", lambda setting: str(_evaluations(setting))),
                *(_error_column(cases, k) for k in self.size.budgets),
            ),
        )
        yield _picture(cases, self.size.budgets)


def entrant_of(setting: ActionDiffusion) -> Entrant:
    """Return a sampler as it takes part; the paper's asks what it asks in the other suites."""
    if setting == PAPER:
        return PAPER_DIFFUSION
    sampler = _settled(setting)
    steps, scale = sampler.settings.steps, sampler.settings.guidance_scale
    name, color = SOLVERS[sampler.solver]
    label = f"{name}, {steps} steps, s = {scale:g}"
    fields = {"method": asdict(setting), "model": PAPER_MODEL}
    return Entrant(label, fields, Look(color, *GUIDANCE[scale]))


def _settled(setting: ActionDiffusion) -> Sampler:
    """Return what a setting is with the paper's model."""
    return setting.settled(PAPER_MODEL_SAMPLERS)


def _name(setting: ActionDiffusion) -> str:
    return SOLVERS[_settled(setting).solver][0] + " (paper)" * (setting == PAPER)


def _evaluations(setting: ActionDiffusion) -> int:
    """Return how often the network is evaluated for a plan."""
    return _settled(setting).cost(1).network_evaluations


def _error_column(cases: Cases, k: int) -> grid.Column[ActionDiffusion]:
    def error(setting: ActionDiffusion) -> str:
        case = cases[setting].at(num_candidates=k)
        mean = f"{case.per_unit(ERROR).mean():.3f}"
        if setting == PAPER:
            return mean
        more = case.less(PAPER_DIFFUSION, ERROR)
        return f"{mean}{'*' * (more.high > MARGIN)} ({more.shown(3, '+')})"

    return grid.Column(f"K = {k}", error)


def _picture(cases: Cases, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(2.8)
    panels = figure.subplots(1, len(budgets), sharey=True)
    for axes, k in zip(panels, budgets, strict=True):
        errors = {each: case.at(num_candidates=k).mean(ERROR) for each, case in cases.items()}
        for scale, solver in product(GUIDANCE, SOLVERS):
            name, color = SOLVERS[solver]
            on_line = sorted(
                (_evaluations(setting), error)
                for setting, error in errors.items()
                if (sampler := _settled(setting)).solver == solver
                and sampler.settings.guidance_scale == scale
            )
            look = Look(color, *GUIDANCE[scale])._asdict()
            axes.plot(*zip(*on_line, strict=True), label=f"{name}, s = {scale:g}", **look)
        axes.axhline(errors[PAPER], color=GREY, lw=0.8)
        axes.plot(
            _evaluations(PAPER), errors[PAPER], "*", color=BLACK, ms=9, label="the paper's setting"
        )
        axes.set(title=f"K = {k}", xlabel="network evaluations", xscale="log", yscale="log")
        axes.set_xticks(EVALUATIONS, labels=[str(number) for number in EVALUATIONS])
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
    panels[0].set_ylabel("mean end error (m)")
    return plots.with_legend(
        figure,
        "Mean end error over the sequences against the network evaluations of a plan; s is the "
        "guidance scale, the grey line the error of the paper's setting.",
        columns=4,
    )
