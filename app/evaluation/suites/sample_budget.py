"""Figure 2: one near target, every method, K and run with the same seeds."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation.cells import mean_and_spread, percent, with_interval
from app.evaluation.comparison import column, rows_of, wins
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    ENTRANTS,
    PAPER_DIFFUSION,
    UNIFORM,
)
from app.evaluation.plots import LEAST_ERROR, draw_over_budget, spread
from app.evaluation.question import Entrant, Question, question_to
from app.evaluation.section import Claim, Picture, Section, Table
from app.evaluation.statistics import (
    TIE,
    Interval,
    interval,
    paired_difference,
)
from app.evaluation.suite import Answered, Suite
from app.evaluation.tables import statistics_table, times_table
from app.evaluation.tasks import REST, State
from app.figures.style import PAGE_INCHES, new_figure
from app.wire.requests import PlanRequest

TARGET = (0.2, 0.0)
SUCCESS = 0.01
"""Plans that end within this distance of the target succeed (m)."""
LOW_ERROR = 0.1 * TARGET[0]
"""Low is a tenth of the way (m)."""
INEFFECTIVE = 0.1
"""A method that succeeds more rarely is largely ineffective."""


@dataclass(frozen=True)
class SampleBudget(Suite):
    """The paper's single-target evaluation over the sample budget, with all methods."""

    name: ClassVar[str] = "sample-budget"
    purpose: ClassVar[str] = "Figure 2: 0.2 m from rest to rest, 30 runs, K = 16 to 512"

    @property
    def budgets(self) -> tuple[int, ...]:
        """K."""
        return (16, 32) if self.quick else (16, 32, 128, 512)

    @property
    def runs(self) -> int:
        """How many runs of each method and K."""
        return 3 if self.quick else 30

    def questions(self) -> Iterator[Question]:
        for k, entrant, run in product(self.budgets, ENTRANTS, range(self.runs)):
            yield run_question(self.seed, run, entrant, TARGET, k)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        return Section(
            title="Single-target sample budget (Figure 2)",
            introduction=(
                f"From rest to {TARGET[0]:g} m, at rest again; {self.runs} runs of each method and "
                "K. The paper leaves CEM out, as its K is a population for each of its iterations: "
                f"{CEM.label} rolls out 40 K sequences, and the other optimisers and the refined "
                "methods spend more than K as well. The rollouts stand in the table. A plan "
                f"succeeds if its terminal error is at most {SUCCESS:g} m."
            ),
            tables=(
                _measures(data, self.budgets),
                statistics_table(
                    data,
                    self.name,
                    "terminal_error",
                    ENTRANTS,
                    "num_candidates",
                    self.budgets,
                    unit="run",
                    digits=4,
                ),
                times_table(data, self.name, "a plan", ENTRANTS, "num_candidates", self.budgets),
                *(_wins(data, k) for k in self.budgets),
            ),
            pictures=(_picture(data, self.budgets),),
            claims=_claims(data, self.budgets),
        )


def run_question(
    seed: int, run: int, entrant: Entrant, target: State, num_candidates: int, **labels: float
) -> Question:
    """Ask `entrant` for a plan from rest at the origin to one target, again for each run.

    Args:
        seed: of the suite; with the run it decides the request's.
        run: from 0.
        entrant: who plans.
        target: position (m) and velocity (m/s).
        num_candidates: K.
        labels: more columns of the suite's data.
    """
    fields = {"initial_state": REST, "target_state": target}
    return question_to(entrant, PlanRequest, fields, num_candidates, seed, 0, run, labels=labels)


def _measures(data: pd.DataFrame, budgets: tuple[int, ...]) -> Table:
    rows = []
    for k, entrant in product(budgets, ENTRANTS):
        of = rows_of(data, entrant, num_candidates=k)
        rows.append(
            (
                entrant.label,
                str(k),
                mean_and_spread(of.terminal_error, 4),
                percent((of.terminal_error <= SUCCESS).mean()),
                mean_and_spread(of.control_energy, 1),
                mean_and_spread(of.stuck_steps, 1),
                f"{of.rollouts.mean():.0f}",
            )
        )
    return Table(
        "sample-budget",
        "Mean ± standard deviation over the runs, and the share of runs that succeed.",
        ("Method", "K", "Terminal error (m)", f"Within {SUCCESS:g} m", "Energy (m²/s⁴)",
         "Stuck steps", "Rollouts"),
        rows,
    )  # fmt: skip


def _wins(data: pd.DataFrame, k: int) -> Table:
    errors = {entrant: _errors(data, entrant, k) for entrant in ENTRANTS}
    return wins(errors, f"sample-budget-wins-{k}", f"Terminal error, K = {k}", "runs")


def _picture(data: pd.DataFrame, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.2)
    axes = figure.subplots(1, 3)
    shown = data.assign(terminal_error=data.terminal_error.clip(lower=LEAST_ERROR))
    draw_over_budget(
        axes[0], shown, ENTRANTS, budgets, "terminal_error", "terminal error (m)", "log",
        unit="run", bars=spread,
    )  # fmt: skip
    for panel, measure, label in (
        (axes[1], "control_energy", "control energy (m²/s⁴)"),
        (axes[2], "stuck_steps", "stuck steps"),
    ):
        draw_over_budget(panel, data, ENTRANTS, budgets, measure, label, unit="run", bars=spread)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return Picture(
        "sample-budget",
        f"From rest to {TARGET[0]:g} m: means over the runs, with a standard deviation to either "
        "side (but not below the least run). Errors below a micrometre are drawn as that.",
        figure,
    )


def _errors(data: pd.DataFrame, entrant: Entrant, k: int) -> NDArray[np.float64]:
    """Return the terminal errors of an entrant's runs, (runs,), in m."""
    return column(data, entrant, "terminal_error", num_candidates=k)


def _claims(data: pd.DataFrame, budgets: tuple[int, ...]) -> tuple[Claim, ...]:
    low = budgets[0]

    def success(entrant: Entrant, k: int) -> float:
        return float(np.mean(_errors(data, entrant, k) <= SUCCESS))

    def error(entrant: Entrant, k: int) -> Interval:
        return interval(_errors(data, entrant, k))

    def shown(entrant: Entrant) -> str:
        of_budgets = (
            f"{with_interval(error(entrant, k), 4)} m at K = {k} "
            f"({percent(success(entrant, k))} within {SUCCESS:g} m)"
            for k in budgets
        )
        return f"{entrant.label}: {', '.join(of_budgets)}."

    lead = {
        k: paired_difference(_errors(data, PAPER_DIFFUSION, k), _errors(data, DATASET_PRIOR, k))
        for k in budgets
    }
    thrifty = {
        k: min(ENTRANTS, key=lambda of: column(data, of, "control_energy", num_candidates=k).mean())
        for k in budgets
    }
    thrifty_error = {k: _errors(data, thrifty[k], k).mean() for k in budgets}
    least_error = {k: min(_errors(data, of, k).mean() for of in ENTRANTS) for k in budgets}
    return (
        Claim(
            "Action Diffusion achieves low terminal error even for small K.",
            error(PAPER_DIFFUSION, low).high < LOW_ERROR,
            f"Low: with 95 % confidence a mean below {LOW_ERROR:g} m, a tenth of the way. "
            + shown(PAPER_DIFFUSION),
        ),
        Claim(
            "The same prior without conditioning ends further from the target.",
            all(difference.high < 0 for difference in lead.values()),
            "Action Diffusion less the dataset prior: "
            + ", ".join(
                f"{with_interval(difference, 4, '+')} m at K = {k}"
                for k, difference in lead.items()
            )
            + ".",
        ),
        Claim(
            "Uniform random shooting remains largely ineffective across all values of K.",
            all(success(UNIFORM, k) < INEFFECTIVE for k in budgets),
            f"Ineffective: fewer than {percent(INEFFECTIVE)} of the runs end within {SUCCESS:g} m. "
            + shown(UNIFORM),
        ),
        Claim(
            "Low energy alone is not sufficient for successful control.",
            all(thrifty_error[k] > least_error[k] + TIE for k in budgets),
            "The method with the least mean energy, its mean error and the least of all: "
            + "; ".join(
                f"K = {k}: {thrifty[k].label}, {thrifty_error[k]:.4f} m, {least_error[k]:.4f} m"
                for k in budgets
            )
            + ".",
        ),
    )
