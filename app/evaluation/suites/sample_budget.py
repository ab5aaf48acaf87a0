"""Figure 2: one near target, every method, K and run with the same seeds."""

from collections.abc import Sequence

import pandas as pd

from app.evaluation import grid
from app.evaluation.case import Case, cases_of
from app.evaluation.cells import percent, with_interval
from app.evaluation.claims import Lead, lower_claim
from app.evaluation.entrants import CEM, DATASET_PRIOR, ENTRANTS, PAPER_DIFFUSION, UNIFORM
from app.evaluation.plots import LEAST_ERROR, draw_legend, draw_over_budget, spread
from app.evaluation.section import Claim, Picture, Section
from app.evaluation.statistics import TIE, interval
from app.evaluation.suite import Answered, Size, Suite
from app.evaluation.tasks import REST, Task
from app.figures.style import PAGE_INCHES, new_figure

TARGET = (0.2, 0.0)
SUCCESS = 0.01
"""Plans that end within this distance of the target succeed (m)."""
LOW_ERROR = 0.1 * TARGET[0]
"""Low is a tenth of the way (m)."""
INEFFECTIVE = 0.1
"""A method that succeeds more rarely is largely ineffective."""
ERROR, ENERGY = "terminal_error", "control_energy"


class SampleBudget(Suite):
    """The paper's single-target evaluation over the sample budget, with all methods."""

    name = "sample-budget"
    purpose = "Figure 2: 0.2 m from rest to rest, 30 runs, K = 16 to 512"
    FULL = Size(budgets=(16, 32, 128, 512), runs=30)
    QUICK = Size(budgets=(16, 32), runs=3)

    def tasks(self) -> list[Task]:
        return [{"initial_state": REST, "target_state": TARGET}]

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        cases = cases_of(data, ENTRANTS, num_candidates=self.size.budgets)
        return Section(
            title="Single-target sample budget (Figure 2)",
            introduction=(
                f"From rest to {TARGET[0]:g} m, at rest again; {self.size.runs} runs of each "
                "method and K. The paper leaves CEM out, as its K is a population for each of its "
                f"iterations: {CEM.label} rolls out 40 K sequences, and the other optimisers and "
                "the refined methods spend more than K as well. The rollouts stand in the table. A "
                f"plan succeeds if its terminal error is at most {SUCCESS:g} m."
            ),
            tables=(
                grid.of_cases(
                    self.name,
                    "Mean ± standard deviation over the runs, and the share of runs that succeed.",
                    cases,
                    grid.spread("Terminal error (m)", ERROR, 4),
                    grid.within(f"Within {SUCCESS:g} m", ERROR, SUCCESS),
                    grid.spread("Energy (m²/s⁴)", ENERGY, 1),
                    grid.spread("Stuck steps", "stuck_steps", 1),
                    grid.mean("Rollouts", "rollouts", 0),
                ),
                grid.statistics(self.name, cases, ERROR, "run", digits=4),
                grid.times(self.name, cases, "a plan"),
                *grid.wins(self.name, cases, ERROR, "Terminal error", "run"),
            ),
            pictures=(_picture(data, self.size.budgets),),
            claims=_claims(data, self.size.budgets),
        )


def _picture(data: pd.DataFrame, budgets: Sequence[int]) -> Picture:
    drawn = data.assign(terminal_error=data.terminal_error.clip(lower=LEAST_ERROR))
    cases = cases_of(drawn, ENTRANTS, num_candidates=budgets)
    figure = new_figure(PAGE_INCHES, 3.2)
    errors, energies, stuck = figure.subplots(1, 3)
    draw_over_budget(errors, cases, ERROR, "terminal error (m)", "log", "run", spread)
    draw_over_budget(energies, cases, ENERGY, "control energy (m²/s⁴)", "linear", "run", spread)
    draw_over_budget(stuck, cases, "stuck_steps", "stuck steps", "linear", "run", spread)
    draw_legend(figure, "outside upper center", columns=5)
    return Picture(
        "sample-budget",
        f"From rest to {TARGET[0]:g} m: means over the runs, with a standard deviation to either "
        "side (but not below the least run). Errors below a micrometre are drawn as that.",
        figure,
    )


def _claims(data: pd.DataFrame, budgets: Sequence[int]) -> tuple[Claim, ...]:
    learned, uniform = (
        cases_of(data, [entrant], num_candidates=budgets) for entrant in (PAPER_DIFFUSION, UNIFORM)
    )
    thrifty = [
        min(cases_of(data, ENTRANTS, num_candidates=[k]), key=lambda case: case.mean(ENERGY))
        for k in budgets
    ]
    least = [
        min(case.with_entrant(entrant).mean(ERROR) for entrant in ENTRANTS) for case in thrifty
    ]
    return (
        Claim(
            "Action Diffusion achieves low terminal error even for small K.",
            interval(learned[0].values(ERROR)).high < LOW_ERROR,
            f"Low: with 95 % confidence a mean below {LOW_ERROR:g} m, a tenth of the way. "
            + _errors(learned),
        ),
        lower_claim(
            "The same prior without conditioning ends further from the target.",
            Lead(
                "the dataset prior",
                {
                    case.place: case.less(case.with_entrant(DATASET_PRIOR), ERROR, "run")
                    for case in learned
                },
                digits=4,
            ),
        ),
        Claim(
            "Uniform random shooting remains largely ineffective across all values of K.",
            all(case.share_within(ERROR, SUCCESS) < INEFFECTIVE for case in uniform),
            f"Ineffective: fewer than {percent(INEFFECTIVE)} of the runs end within {SUCCESS:g} m. "
            + _errors(uniform),
        ),
        Claim(
            "Low energy alone is not sufficient for successful control.",
            all(case.mean(ERROR) > error + TIE for case, error in zip(thrifty, least, strict=True)),
            "The method with the least mean energy, its mean error and the least of all: "
            + "; ".join(
                f"{case.place}: {case.entrant.label}, {case.mean(ERROR):.4f} m, {error:.4f} m"
                for case, error in zip(thrifty, least, strict=True)
            )
            + ".",
        ),
    )


def _errors(cases: list[Case]) -> str:
    """Say how far from the target an entrant ends at each K."""
    shown = (
        f"{with_interval(interval(case.values(ERROR)), 4)} m at {case.place} "
        f"({percent(case.share_within(ERROR, SUCCESS))} within {SUCCESS:g} m)"
        for case in cases
    )
    return f"{cases[0].entrant.label}: {', '.join(shown)}."
