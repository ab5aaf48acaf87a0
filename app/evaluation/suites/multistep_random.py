"""Table 2: random sequences of three targets, every method, K and run with the same seeds."""

import pandas as pd

from app.evaluation import claims, grid, paper, plots
from app.evaluation.case import Case, cases_of
from app.evaluation.entrants import CEM, DATASET_PRIOR, ENTRANTS, PAPER_DIFFUSION, PAPER_ENTRANTS
from app.evaluation.suite import Claim, Parts, Picture, Size, Suite
from app.evaluation.tasks import TARGETS_PER_SEQUENCE, sequence_tasks
from app.figures.style import new_figure

ERROR = "mean_end_error"


class MultistepRandom(Suite):
    """Table 2: 30 random sequences x 5 runs, all methods, K = 16 to 512."""

    name = "multistep-random"
    title = "Random multi-step references (Table 2)"
    draw_tasks = staticmethod(sequence_tasks)
    FULL = Size(budgets=(16, 32, 128, 512), tasks=30, runs=5)
    QUICK = Size(budgets=(16, 32), tasks=3, runs=2)

    def report(self, data: pd.DataFrame) -> Parts:
        seconds = {f"{name}_s": data[f"{name}_ms"] / 1e3 for name in ("compute", "latency")}
        cases = cases_of(
            data.assign(
                plan_ms=data.compute_ms / TARGETS_PER_SEQUENCE,
                plan_energy=data.control_energy / TARGETS_PER_SEQUENCE,
                **seconds,
            ),
            ENTRANTS,
            num_candidates=self.size.budgets,
        )
        yield (
            f"From rest, {TARGETS_PER_SEQUENCE} targets one after the other, each at rest "
            f"somewhere in [-1, 1] m; {self.size.tasks} sequences, {self.size.runs} runs of each. "
            "The floor is what no plan can go below, from where each segment of the method's own "
            "plan starts: a method that hardly moves has a low one."
        )
        yield grid.of_cases(
            "Mean ± standard deviation, the paper's beside; lower is better.",
            cases,
            grid.spread("Final error (m)", "final_error", 3),
            _printed("final_error"),
            grid.spread("Mean end error (m)", ERROR, 3),
            _printed("mean_end_error"),
            grid.mean("Floor (m)", "mean_end_floor", 3),
            grid.spread("Stuck steps", "stuck_steps", 1),
            _printed("stuck_steps"),
        )
        yield grid.of_cases(
            "What a method is to blame for, the gap: mean end error less its floor; and the energy "
            "of a plan.",
            cases,
            grid.mean("Gap (m)", "mean_end_gap", 4),
            grid.mean("Energy (m²/s⁴)", "plan_energy", 1),
            part="plans",
        )
        yield grid.statistics(cases, ERROR)
        yield grid.of_cases(
            "Wall-clock for a sequence of three plans: the service's compute time, and what the "
            "client waited. The paper's machine is another one.",
            cases,
            grid.spread("Time (s)", "compute_s", 3),
            _printed("time"),
            grid.mean("ms a plan", "plan_ms", 1),
            grid.spread("Client latency (s)", "latency_s", 3),
            part="time",
        )
        yield from grid.wins(cases, ERROR, "Mean end error over the runs")
        yield _picture(cases)
        yield from _claims([case for case in cases if case.entrant == PAPER_DIFFUSION])


def _printed(field: str) -> grid.Column[Case]:
    """Show what the paper prints."""

    def cell(case: Case) -> str:
        row = paper.MULTISTEP.get((case.entrant, case.where["num_candidates"]))
        return row._asdict()[field] if row else ""

    return grid.Column("paper", cell)


def _picture(cases: list[Case]) -> Picture:
    figure = new_figure(3.0)
    errors, stuck = figure.subplots(1, 2)
    plots.draw_over_budget(errors, cases, ERROR, "mean end error (m)", "log")
    plots.draw_over_budget(stuck, cases, "stuck_steps", "stuck steps")
    return plots.with_legend(
        figure,
        "Random multi-step references: means over the sequences and runs, with 95 % intervals.",
    )


def _claims(learned: list[Case]) -> Parts:
    over_cem, over_prior = (
        claims.lead_over(other, learned, ERROR) for other in (CEM, DATASET_PRIOR)
    )
    low, *_, high = (case.place for case in learned)
    first, last = over_cem.differences[low], over_cem.differences[high]
    last_over_prior = over_prior.differences[high]
    better = [
        entrant.label
        for entrant in ENTRANTS
        if all(case.with_entrant(entrant).less(case, ERROR).high < 0 for case in learned)
    ]
    yield Claim(
        "At a small budget Action Diffusion ends nearer to the targets than CEM.",
        first.high < 0,
        str(over_cem),
    )
    yield Claim(
        "At larger budgets CEM improves, and the advantage becomes less pronounced.",
        over_cem.narrows,
        f"The lead is {-first.estimate:.3f} m at {low} and {-last.estimate:.3f} m at {high}.",
    )
    yield Claim(
        f"At {high} Action Diffusion still has the lowest mean end error of the paper's three "
        "methods.",
        max(last.high, last_over_prior.high) < 0,
        f"Less CEM: {last.shown(3, '+')} m; less the dataset prior: "
        f"{last_over_prior.shown(3, '+')} m.",
    )
    yield claims.lower(
        "The structured prior alone is not sufficient: conditioning it is what helps.", over_prior
    )
    yield claims.lowest(
        "Action Diffusion has the fewest stuck steps of the paper's three methods at every K.",
        PAPER_DIFFUSION,
        {
            case.place: {
                each: case.with_entrant(each).mean("stuck_steps") for each in PAPER_ENTRANTS
            }
            for case in learned
        },
        "{:.1f}",
    )
    yield Claim(
        "Action Diffusion has the lowest mean end error of all (beyond the paper's three).",
        not better,
        f"Better at every K, with 95 % confidence: {', '.join(better) or 'none'}.",
    )
