"""Table 2: random sequences of three targets, every method, K and run with the same seeds."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation import paper
from app.evaluation.cells import mean_and_spread, with_interval
from app.evaluation.comparison import column, per_unit, rows_of, wins
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    ENTRANTS,
    PAPER_DIFFUSION,
    PAPER_ENTRANTS,
)
from app.evaluation.plots import draw_over_budget
from app.evaluation.question import Entrant, Question, question_to
from app.evaluation.section import Claim, Picture, Section, Table
from app.evaluation.statistics import (
    Interval,
    paired_difference,
)
from app.evaluation.suite import Answered, Suite
from app.evaluation.tables import statistics_table
from app.evaluation.tasks import REST, TARGETS_PER_SEQUENCE, random_sequences
from app.figures.style import PAGE_INCHES, new_figure
from app.planning.plant.system import System
from app.wire.requests import MultistepPlanRequest


@dataclass(frozen=True)
class MultistepRandom(Suite):
    """The paper's random multi-step evaluation, with all methods."""

    name: ClassVar[str] = "multistep-random"
    purpose: ClassVar[str] = "Table 2: 30 random sequences x 5 runs, all methods, K = 16 to 512"

    @property
    def budgets(self) -> tuple[int, ...]:
        """K."""
        return (16, 32) if self.quick else (16, 32, 128, 512)

    @property
    def size(self) -> tuple[int, int]:
        """Return how many sequences, and how many runs of each."""
        return (3, 2) if self.quick else (30, 5)

    def questions(self) -> Iterator[Question]:
        for k, entrant in product(self.budgets, ENTRANTS):
            yield from sequence_questions(self.seed, self.size, entrant, k)

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        sequences, runs = self.size
        return Section(
            title="Random multi-step references (Table 2)",
            introduction=(
                f"From rest, {TARGETS_PER_SEQUENCE} targets one after the other, each at rest "
                f"somewhere in [-1, 1] m; {sequences} sequences, {runs} runs of each. The floor is "
                "what no plan can go below, from where each segment of the method's own plan "
                "starts: a method that hardly moves has a low one."
            ),
            tables=(
                _errors(data, self.budgets),
                statistics_table(
                    data, self.name, "mean_end_error", ENTRANTS, "num_candidates", self.budgets
                ),
                _times(data, self.budgets),
                *(_wins(data, k) for k in self.budgets),
            ),
            pictures=(_picture(data, self.budgets),),
            claims=_claims(data, self.budgets),
        )


def sequence_questions(
    seed: int,
    size: tuple[int, int],
    entrant: Entrant,
    num_candidates: int,
    system: System | None = None,
    **labels: float,
) -> Iterator[Question]:
    """Ask `entrant` for plans along random sequences.

    Args:
        seed: decides the sequences and the requests' seeds.
        size: sequences, and runs of each.
        entrant: who plans.
        num_candidates: K.
        system: the plant, where it is not the nominal one.
        labels: more columns of the suite's data.
    """
    num_sequences, num_runs = size
    sequences = random_sequences(num_sequences, seed)
    for task, run in product(range(num_sequences), range(num_runs)):
        fields = {"initial_state": REST, "targets": sequences[task], "system": system}
        yield question_to(
            entrant, MultistepPlanRequest, fields, num_candidates, seed, task, run, labels=labels
        )


def _errors(data: pd.DataFrame, budgets: tuple[int, ...]) -> Table:
    rows = []
    for k, entrant in product(budgets, ENTRANTS):
        of = rows_of(data, entrant, num_candidates=k)
        printed = paper.MULTISTEP.get((entrant, k), paper.NO_MULTISTEP_ROW)
        rows.append(
            (
                entrant.label,
                str(k),
                mean_and_spread(of.final_error, 3),
                printed.final_error,
                mean_and_spread(of.mean_end_error, 3),
                printed.mean_end_error,
                f"{of.mean_end_floor.mean():.3f}",
                mean_and_spread(of.stuck_steps, 1),
                printed.stuck_steps,
            )
        )
    return Table(
        "multistep-random",
        "Mean ± standard deviation, the paper's beside; lower is better.",
        ("Method", "K", "Final error (m)", "paper", "Mean end error (m)", "paper", "Floor (m)",
         "Stuck steps", "paper"),
        rows,
    )  # fmt: skip


def _times(data: pd.DataFrame, budgets: tuple[int, ...]) -> Table:
    rows = []
    for k, entrant in product(budgets, ENTRANTS):
        compute = column(data, entrant, "compute_ms", num_candidates=k)
        latency = column(data, entrant, "latency_ms", num_candidates=k)
        rows.append(
            (
                entrant.label,
                str(k),
                mean_and_spread(compute / 1e3, 3),
                paper.MULTISTEP.get((entrant, k), paper.NO_MULTISTEP_ROW).time,
                f"{compute.mean() / TARGETS_PER_SEQUENCE:.1f}",
                mean_and_spread(latency / 1e3, 3),
            )
        )
    return Table(
        "multistep-random-time",
        "Wall-clock for a sequence of three plans: the service's compute time, and what the client "
        "waited. The paper's machine is another one.",
        ("Method", "K", "Time (s)", "paper", "ms a plan", "Client latency (s)"),
        rows,
    )


def _wins(data: pd.DataFrame, k: int) -> Table:
    errors = {
        entrant: per_unit(data, entrant, "mean_end_error", num_candidates=k) for entrant in ENTRANTS
    }
    return wins(errors, f"multistep-random-wins-{k}", f"Mean end error over the runs, K = {k}")


def _picture(data: pd.DataFrame, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.0)
    axes = figure.subplots(1, 2)
    draw_over_budget(
        axes[0], data, ENTRANTS, budgets, "mean_end_error", "mean end error (m)", "log"
    )
    draw_over_budget(axes[1], data, ENTRANTS, budgets, "stuck_steps", "stuck steps")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper")
    return Picture(
        "multistep-random",
        "Random multi-step references: means over the sequences and runs, with 95 % intervals.",
        figure,
    )


def _claims(data: pd.DataFrame, budgets: tuple[int, ...]) -> tuple[Claim, ...]:
    low, high = budgets[0], budgets[-1]

    def errors(entrant: Entrant, k: int) -> NDArray[np.float64]:
        return per_unit(data, entrant, "mean_end_error", num_candidates=k)

    def lead(k: int, other: Entrant) -> Interval:
        return paired_difference(errors(PAPER_DIFFUSION, k), errors(other, k))

    def leads(other: Entrant) -> str:
        shown = (f"{with_interval(lead(k, other), 3, '+')} m at K = {k}" for k in budgets)
        return f"Action Diffusion less {other.label}: {', '.join(shown)}."

    stuck = {
        k: {of: column(data, of, "stuck_steps", num_candidates=k).mean() for of in PAPER_ENTRANTS}
        for k in budgets
    }
    better = [
        entrant.label
        for entrant in ENTRANTS
        if all(paired_difference(errors(entrant, k), errors(PAPER_DIFFUSION, k)).high < 0
               for k in budgets)
    ]  # fmt: skip
    return (
        Claim(
            "At a small budget Action Diffusion ends nearer to the targets than CEM.",
            lead(low, CEM).high < 0,
            leads(CEM),
        ),
        Claim(
            "At larger budgets CEM improves, and the advantage becomes less pronounced.",
            lead(high, CEM).estimate > lead(low, CEM).estimate,
            f"The lead is {-lead(low, CEM).estimate:.3f} m at K = {low} and "
            f"{-lead(high, CEM).estimate:.3f} m at K = {high}.",
        ),
        Claim(
            f"At K = {high} Action Diffusion still has the lowest mean end error of the "
            "paper's three methods.",
            max(lead(high, CEM).high, lead(high, DATASET_PRIOR).high) < 0,
            f"Less CEM: {with_interval(lead(high, CEM), 3, '+')} m; less the dataset prior: "
            f"{with_interval(lead(high, DATASET_PRIOR), 3, '+')} m.",
        ),
        Claim(
            "The structured prior alone is not sufficient: conditioning it is what helps.",
            all(lead(k, DATASET_PRIOR).high < 0 for k in budgets),
            leads(DATASET_PRIOR),
        ),
        Claim(
            "Action Diffusion has the fewest stuck steps of the paper's three methods at every K.",
            all(min(of, key=lambda e: of[e]) == PAPER_DIFFUSION for of in stuck.values()),
            "; ".join(
                f"K = {k}: " + ", ".join(f"{of.label} {mean:.1f}" for of, mean in means.items())
                for k, means in stuck.items()
            )
            + ".",
        ),
        Claim(
            "Action Diffusion has the lowest mean end error of all (beyond the paper's three).",
            not better,
            f"Better at every K, with 95 % confidence: {', '.join(better) or 'none'}.",
        ),
    )
