"""Figure 2: one near target, every method, K and run with the same seeds."""

import pandas as pd

from app.evaluation import claims, grid, plots
from app.evaluation.case import Case, cases_of
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    ENTRANTS,
    PAPER_DIFFUSION,
    PAPER_ENTRANTS,
    UNIFORM,
)
from app.evaluation.statistics import TIE, interval, percent
from app.evaluation.suite import Claim, Parts, Picture, Size, Suite
from app.evaluation.tasks import one_task
from app.figures.style import new_figure

TARGET = (0.2, 0.0)
SUCCESS = 0.01
"""Plans that end within this distance of the target succeed (m)."""
LOW_ERROR = 0.1 * TARGET[0]
"""Low is a tenth of the way (m)."""
INEFFECTIVE = 0.1
"""A method that succeeds more rarely is largely ineffective."""
ERROR, ENERGY = "terminal_error", "control_energy"


class SampleBudget(Suite):
    """Figure 2: 0.2 m from rest to rest, 30 runs, K = 16 to 512."""

    name = "sample-budget"
    title = "Single-target sample budget (Figure 2)"
    draw_tasks = staticmethod(one_task(target_state=TARGET))
    FULL = Size(budgets=(16, 32, 128, 512), runs=30)
    QUICK = Size(budgets=(16, 32), runs=3)

    def report(self, data: pd.DataFrame) -> Parts:
        cases = cases_of(data, ENTRANTS, num_candidates=self.size.budgets)
        yield (
            f"From rest to {TARGET[0]:g} m, at rest again; {self.size.runs} runs of each method "
            "and K. The paper leaves CEM out, as its K is a population for each of its iterations: "
            f"{CEM.label} rolls out 40 K sequences, and the other optimisers and the refined "
            "methods spend more than K as well. The rollouts stand in the table. A plan succeeds "
            f"if its terminal error is at most {SUCCESS:g} m."
        )
        yield grid.of_cases(
            "Mean ± standard deviation over the runs, and the share of runs that succeed.",
            cases,
            grid.spread("Terminal error (m)", ERROR, 4),
            grid.within(f"Within {SUCCESS:g} m", ERROR, SUCCESS),
            grid.spread("Energy (m²/s⁴)", ENERGY, 1),
            grid.spread("Stuck steps", "stuck_steps", 1),
            grid.mean("Rollouts", "rollouts", 0),
        )
        yield grid.statistics(cases, ERROR, digits=4)
        yield grid.times(cases, "a plan")
        yield from grid.wins(cases, ERROR, "Terminal error")
        drawn = data.assign(terminal_error=data.terminal_error.clip(lower=plots.LEAST_ERROR))
        yield _picture(cases_of(drawn, ENTRANTS, num_candidates=self.size.budgets))
        yield from _claims(cases)


def _picture(cases: list[Case]) -> Picture:
    figure = new_figure(3.2)
    errors, energies, stuck = figure.subplots(1, 3)
    plots.draw_over_budget(errors, cases, ERROR, "terminal error (m)", "log", plots.spread)
    plots.draw_over_budget(energies, cases, ENERGY, "control energy (m²/s⁴)", bars=plots.spread)
    plots.draw_over_budget(stuck, cases, "stuck_steps", "stuck steps", bars=plots.spread)
    return plots.with_legend(
        figure,
        f"From rest to {TARGET[0]:g} m: means over the runs, with a standard deviation to either "
        "side (but not below the least run). Errors below a micrometre are drawn as that.",
        columns=5,
    )


def _claims(cases: list[Case]) -> Parts:
    learned, uniform = (
        [case for case in cases if case.entrant == entrant]
        for entrant in (PAPER_DIFFUSION, UNIFORM)
    )
    yield Claim(
        "Action Diffusion achieves low terminal error even for small K.",
        interval(learned[0].values(ERROR)).high < LOW_ERROR,
        f"Low: with 95 % confidence a mean below {LOW_ERROR:g} m, a tenth of the way. "
        + _errors(learned),
    )
    over_prior = {case.place: case.less(DATASET_PRIOR, ERROR) for case in learned}
    yield claims.lower(
        "The same prior without conditioning ends further from the target.",
        claims.Lead("the dataset prior", over_prior, digits=4),
    )
    yield Claim(
        "Uniform random shooting remains largely ineffective across all values of K.",
        all(case.share_within(ERROR, SUCCESS) < INEFFECTIVE for case in uniform),
        f"Ineffective: fewer than {percent(INEFFECTIVE)} of the runs end within {SUCCESS:g} m. "
        + _errors(uniform),
    )
    compared = (*PAPER_ENTRANTS, UNIFORM)
    at_each_k = [[case.with_entrant(entrant) for entrant in compared] for case in learned]
    thrifty = [min(rivals, key=lambda case: case.mean(ENERGY)) for rivals in at_each_k]
    least = [min(case.mean(ERROR) for case in rivals) for rivals in at_each_k]
    shown = (
        f"{case.place}: {case.entrant.label}, {case.mean(ERROR):.4f} m, {error:.4f} m"
        for case, error in zip(thrifty, least, strict=True)
    )
    yield Claim(
        "Low energy alone is not sufficient for successful control.",
        all(case.mean(ERROR) > error + TIE for case, error in zip(thrifty, least, strict=True)),
        "Of the paper's methods, the one with the least mean energy, its mean error and the least "
        "of all: "
        f"{'; '.join(shown)}.",
    )


def _errors(cases: list[Case]) -> str:
    """Say how far from the target an entrant ends at each K."""
    shown = (
        f"{interval(case.values(ERROR)).shown(4)} m at {case.place} "
        f"({percent(case.share_within(ERROR, SUCCESS))} within {SUCCESS:g} m)"
        for case in cases
    )
    return f"{cases[0].entrant.label}: {', '.join(shown)}."
