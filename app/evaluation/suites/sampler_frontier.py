"""Error against network evaluations, for samplers of two models: paired, on the same tasks.

The tasks are the random multi-step ones; the paper's setting is what the others are compared with.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import product
from typing import NamedTuple, TypeAlias

import pandas as pd
from matplotlib.ticker import LogLocator, NullFormatter

from app.evaluation import grid, plots
from app.evaluation.case import Case, taking_part
from app.evaluation.entrants import ANY_MODEL, PAPER_DIFFUSION, PAPER_MODEL
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Parts, Picture, Size, Suite, Table
from app.evaluation.tasks import sequence_tasks
from app.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, RED, Look, new_figure
from app.planning.methods import ActionDiffusion
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Sampler, Solver


class Setting(NamedTuple):
    """A sampler of a model."""

    method: ActionDiffusion
    model: str

    @property
    def sampler(self) -> Sampler:
        """The sampler that is meant: but for the default all say their steps and scale."""
        return self.method.settled(PAPER_MODEL_SAMPLERS)

    @property
    def evaluations(self) -> int:
        """How often the network is evaluated for a plan."""
        return self.sampler.cost(1).network_evaluations


def _settings(model: str, solver: Solver, *sizes: tuple[int, float]) -> Iterator[Setting]:
    for steps, scale in sizes:
        yield Setting(ActionDiffusion("action_diffusion", solver, steps, scale), model)


PAPER = Setting(ActionDiffusion(sampler="paper"), PAPER_MODEL)
SETTINGS = (
    PAPER,
    *_settings(PAPER_MODEL, "ddim", (2, 1), (5, 1), (5, 1.5), (10, 1), (10, 1.5), (10, 2), (20, 2)),
    *_settings(
        PAPER_MODEL,
        "dpm_solver",
        *((1, 1), (2, 1), (4, 1), (2, 2), (3, 2), (4, 1.5), (4, 2), (6, 2), (10, 2)),
    ),
    *_settings(ANY_MODEL, "ddim", (2, 1), (3, 1), (6, 1), (10, 1)),
    *_settings(ANY_MODEL, "dpm_solver", (1, 1), (2, 1), (3, 1), (4, 1), (6, 1), (3, 1.5)),
)
Cases: TypeAlias = dict[Setting, Case]
ERROR = "mean_end_error"
MARGIN = 0.005
"""A setting is not inferior if its mean end error is, at 95 %, at most this much above (m)."""

SOLVERS: dict[Solver, str] = {"ddim": "DDIM", "dpm_solver": "DPM-Solver++"}
MODELS = {PAPER_MODEL: "the paper's plant", ANY_MODEL: "every machine"}
"""What the models are of."""
COLORS: dict[tuple[str, Solver], str] = {
    (PAPER_MODEL, "ddim"): BLUE,
    (PAPER_MODEL, "dpm_solver"): RED,
    (ANY_MODEL, "ddim"): GREEN,
    (ANY_MODEL, "dpm_solver"): ORANGE,
}
GUIDANCE = {1.0: ("o", ":"), 1.5: ("^", "--"), 2.0: ("s", "-")}
"""Marker and line, by scale."""
EVALUATIONS = (1, 2, 5, 10, 20, 50, 100)
"""Ticks."""


class SamplerFrontier(Suite):
    """Error against network evaluations: samplers of the paper's model and of every machine's."""

    name = "sampler-frontier"
    title = "Error against network evaluations"
    draw_tasks = staticmethod(sequence_tasks)
    FULL = Size(budgets=(1, 16, 128), tasks=50)
    QUICK = Size(budgets=(1, 4), tasks=3)

    def questions(self) -> Iterator[Question]:
        for k, setting in product(self.size.budgets, SETTINGS):
            settings = setting.sampler.settings
            yield from self.ask(
                entrant_of(setting),
                k,
                if_covered=setting.model == ANY_MODEL,
                steps=settings.steps,
                guidance_scale=settings.guidance_scale,
            )

    def report(self, data: pd.DataFrame) -> Parts:
        present = taking_part(data, map(entrant_of, SETTINGS))
        cases = {
            setting: Case(data, entrant, {})
            for setting in SETTINGS
            if (entrant := entrant_of(setting)) in present
        }
        yield (
            f"Samplers of learned models on the same {self.size.tasks} random multi-step "
            "sequences. The paper samples with 50 DDIM steps of two network evaluations each, and "
            "guidance scale s = 2; without guidance (s = 1) a step takes one evaluation. The model "
            f"of {MODELS[PAPER_MODEL]} predicts the noise, that of {MODELS[ANY_MODEL]} the clean "
            "controls. Each model has a default of its own (`GET /models`)."
        )
        for model, of_what in MODELS.items():
            shown = [setting for setting in cases if setting.model == model]
            if shown:
                yield _errors(cases, shown, self.size.budgets)
            # Answers of earlier services do not say how diverse the candidates were.
            if known := [each for each in shown if cases[each].rows.diversity.notna().all()]:
                yield grid.table(
                    f"Diversity of the candidates, the model of {of_what}: standard deviation of "
                    "their controls (m/s²).",
                    known,
                    (*COLUMNS, *(_diversity(cases, k) for k in self.size.budgets)),
                    part=f"{model}-diversity",
                )
        yield _picture(cases, self.size.budgets)


def entrant_of(setting: Setting) -> Entrant:
    """Return a sampler as it takes part; the paper's asks what it asks in the other suites."""
    if setting == PAPER:
        return PAPER_DIFFUSION
    sampler = setting.sampler
    steps, scale = sampler.settings.steps, sampler.settings.guidance_scale
    label = f"{SOLVERS[sampler.solver]}, {steps} steps, s = {scale:g}, {MODELS[setting.model]}"
    fields = {"method": asdict(setting.method), "model": setting.model}
    return Entrant(label, fields, Look(COLORS[setting.model, sampler.solver], *GUIDANCE[scale]))


COLUMNS: tuple[grid.Column[Setting], ...] = (
    grid.Column(
        "Sampler", lambda setting: SOLVERS[setting.sampler.solver] + " (paper)" * (setting == PAPER)
    ),
    grid.Column("Steps", lambda setting: str(setting.sampler.settings.steps)),
    grid.Column("s", lambda setting: f"{setting.sampler.settings.guidance_scale:g}"),
    grid.Column("Evaluations", lambda setting: str(setting.evaluations)),
)


def _errors(cases: Cases, shown: Sequence[Setting], budgets: tuple[int, ...]) -> Table:
    model = shown[0].model
    return grid.table(
        f"The model of {MODELS[model]}: mean end error (m), and in parentheses what it is more "
        "than that of the paper's setting, with its 95 % bootstrap interval over the sequences, "
        f"paired; an asterisk marks what may be more than {MARGIN:g} m worse.",
        shown,
        (*COLUMNS, *(_error(cases, k) for k in budgets)),
        part="" if model == PAPER_MODEL else model,
    )


def _error(cases: Cases, k: int) -> grid.Column[Setting]:
    def shown(setting: Setting) -> str:
        case = cases[setting].at(num_candidates=k)
        mean = f"{case.per_unit(ERROR).mean():.3f}"
        if setting == PAPER:
            return mean
        more = case.less(PAPER_DIFFUSION, ERROR)
        return f"{mean}{'*' * (more.high > MARGIN)} ({more.shown(3, '+')})"

    return grid.Column(f"K = {k}", shown)


def _diversity(cases: Cases, k: int) -> grid.Column[Setting]:
    return grid.Column(
        f"K = {k}",
        lambda setting: f"{cases[setting].at(num_candidates=k).mean('diversity'):.3f}",
    )


def _picture(cases: Cases, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(2.8)
    panels = figure.subplots(1, len(budgets), sharey=True)
    for axes, k in zip(panels, budgets, strict=True):
        errors = {each: case.at(num_candidates=k).mean(ERROR) for each, case in cases.items()}
        for (model, solver), scale in product(COLORS, GUIDANCE):
            on_line = sorted(
                (setting.evaluations, error)
                for setting, error in errors.items()
                if (setting.model, setting.sampler.solver) == (model, solver)
                and setting.sampler.settings.guidance_scale == scale
            )
            if on_line:
                look = Look(COLORS[model, solver], *GUIDANCE[scale])._asdict()
                label = f"{SOLVERS[solver]}, s = {scale:g}, {MODELS[model]}"
                axes.plot(*zip(*on_line, strict=True), label=label, **look)
        axes.axhline(errors[PAPER], color=GREY, lw=0.8)
        axes.plot(
            PAPER.evaluations, errors[PAPER], "*", color=BLACK, ms=9, label="the paper's setting"
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
        columns=3,
    )
