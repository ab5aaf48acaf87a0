"""Table 2: random sequences of three targets, every method, K and run with the same seeds."""

from collections.abc import Sequence

import pandas as pd

from app.evaluation import grid, paper
from app.evaluation.case import Case, cases_of
from app.evaluation.cells import mean_and_spread, with_interval
from app.evaluation.claims import lead_over, lower_claim, lowest_claim
from app.evaluation.entrants import CEM, DATASET_PRIOR, ENTRANTS, PAPER_DIFFUSION, PAPER_ENTRANTS
from app.evaluation.plots import draw_legend, draw_over_budget
from app.evaluation.section import Claim, Picture, Section
from app.evaluation.suite import Answered, Size, Suite
from app.evaluation.tasks import TARGETS_PER_SEQUENCE, Task, sequence_tasks
from app.figures.style import PAGE_INCHES, new_figure

ERROR = "mean_end_error"


class MultistepRandom(Suite):
    """The paper's random multi-step evaluation, with all methods."""

    name = "multistep-random"
    purpose = "Table 2: 30 random sequences x 5 runs, all methods, K = 16 to 512"
    FULL = Size(budgets=(16, 32, 128, 512), tasks=30, runs=5)
    QUICK = Size(budgets=(16, 32), tasks=3, runs=2)

    def tasks(self) -> list[Task]:
        return sequence_tasks(self.size.tasks, self.seed)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        cases = cases_of(data, ENTRANTS, num_candidates=self.size.budgets)
        return Section(
            title="Random multi-step references (Table 2)",
            introduction=(
                f"From rest, {TARGETS_PER_SEQUENCE} targets one after the other, each at rest "
                f"somewhere in [-1, 1] m; {self.size.tasks} sequences, {self.size.runs} runs of "
                "each. The floor is what no plan can go below, from where each segment of the "
                "method's own plan starts: a method that hardly moves has a low one."
            ),
            tables=(
                grid.of_cases(
                    self.name,
                    "Mean ± standard deviation, the paper's beside; lower is better.",
                    cases,
                    grid.spread("Final error (m)", "final_error", 3),
                    _paper_column("final_error"),
                    grid.spread("Mean end error (m)", ERROR, 3),
                    _paper_column("mean_end_error"),
                    grid.mean("Floor (m)", "mean_end_floor", 3),
                    grid.spread("Stuck steps", "stuck_steps", 1),
                    _paper_column("stuck_steps"),
                ),
                grid.statistics(self.name, cases, ERROR),
                grid.of_cases(
                    f"{self.name}-time",
                    "Wall-clock for a sequence of three plans: the service's compute time, and "
                    "what the client waited. The paper's machine is another one.",
                    cases,
                    _seconds_column("Time (s)", "compute_ms"),
                    _paper_column("time"),
                    grid.Column("ms a plan", _per_plan),
                    _seconds_column("Client latency (s)", "latency_ms"),
                ),
                *grid.wins(self.name, cases, ERROR, "Mean end error over the runs"),
            ),
            pictures=(_picture(cases),),
            claims=_claims(data, self.size.budgets),
        )


def _paper_column(field: str) -> grid.Column[Case]:
    """Show what the paper prints."""

    def printed(case: Case) -> str:
        row = paper.MULTISTEP.get((case.entrant, case.where["num_candidates"]))
        return row._asdict()[field] if row else ""

    return grid.Column("paper", printed)


def _seconds_column(heading: str, measure: str) -> grid.Column[Case]:
    return grid.Column(heading, lambda case: mean_and_spread(case.values(measure) / 1e3, 3))


def _per_plan(case: Case) -> str:
    return f"{case.mean('compute_ms') / TARGETS_PER_SEQUENCE:.1f}"


def _picture(cases: list[Case]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.0)
    errors, stuck = figure.subplots(1, 2)
    draw_over_budget(errors, cases, ERROR, "mean end error (m)", "log")
    draw_over_budget(stuck, cases, "stuck_steps", "stuck steps")
    draw_legend(figure, "outside right upper")
    return Picture(
        "multistep-random",
        "Random multi-step references: means over the sequences and runs, with 95 % intervals.",
        figure,
    )


def _claims(data: pd.DataFrame, budgets: Sequence[int]) -> tuple[Claim, ...]:
    learned = cases_of(data, [PAPER_DIFFUSION], num_candidates=budgets)
    over_cem, over_prior = (lead_over(other, learned, ERROR) for other in (CEM, DATASET_PRIOR))
    low, *_, high = (case.place for case in learned)
    first, last = over_cem.differences[low], over_cem.differences[high]
    last_over_prior = over_prior.differences[high]
    better = [
        entrant.label
        for entrant in ENTRANTS
        if all(case.with_entrant(entrant).less(case, ERROR).high < 0 for case in learned)
    ]
    return (
        Claim(
            "At a small budget Action Diffusion ends nearer to the targets than CEM.",
            first.high < 0,
            str(over_cem),
        ),
        Claim(
            "At larger budgets CEM improves, and the advantage becomes less pronounced.",
            over_cem.narrows,
            f"The lead is {-first.estimate:.3f} m at {low} and {-last.estimate:.3f} m at {high}.",
        ),
        Claim(
            f"At {high} Action Diffusion still has the lowest mean end error of the paper's three "
            "methods.",
            max(last.high, last_over_prior.high) < 0,
            f"Less CEM: {with_interval(last, 3, '+')} m; less the dataset prior: "
            f"{with_interval(last_over_prior, 3, '+')} m.",
        ),
        lower_claim(
            "The structured prior alone is not sufficient: conditioning it is what helps.",
            over_prior,
        ),
        lowest_claim(
            "Action Diffusion has the fewest stuck steps of the paper's three methods at every K.",
            PAPER_DIFFUSION,
            {
                case.place: {
                    each: case.with_entrant(each).mean("stuck_steps") for each in PAPER_ENTRANTS
                }
                for case in learned
            },
            "{:.1f}",
        ),
        Claim(
            "Action Diffusion has the lowest mean end error of all (beyond the paper's three).",
            not better,
            f"Better at every K, with 95 % confidence: {', '.join(better) or 'none'}.",
        ),
    )
