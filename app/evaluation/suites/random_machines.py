"""Beyond the paper's plant: random transitions on plants of real machines, method by method."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of, taking_part
from app.evaluation.entrants import (
    CEM,
    DIFFUSION,
    ENTRANTS,
    PAPER_DIFFUSION,
    REFINED_DIFFUSION,
    REFINED_PRIOR,
)
from app.evaluation.question import Question
from app.evaluation.statistics import Interval, interval, percent
from app.evaluation.suite import Claim, Parts, Picture, Row, Size, Suite, Table
from app.evaluation.tasks import FARTHEST, FASTEST, machine_tasks, scale_of
from app.figures.style import new_figure
from app.planning.plant.machines import MACHINES, Machine
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON

ARRIVAL = 1e-6
"""A plan whose gap is no larger arrives, in the machine's units."""
LEARNED = (DIFFUSION, REFINED_DIFFUSION)
"""Take part on the machines that the service has a model for."""
WIDTH = 0.6
"""Over which a figure spreads the entrants about each machine; machines are 1 apart."""


class RandomMachines(Suite):
    """Random starts and targets on the plants of real machines, K = 16 and 128."""

    name = "random-machines"
    title = "Random targets on the plants of real machines"
    FULL = Size(budgets=(16, 128), tasks=200)
    QUICK = Size(budgets=(16,), tasks=8)

    def questions(self) -> Iterator[Question]:
        for machine, k in product(MACHINES.values(), self.size.budgets):
            for entrant in ENTRANTS:
                # The paper's model is of the paper's plant.
                if entrant != PAPER_DIFFUSION or machine.system == System():
                    yield from self.ask(
                        entrant,
                        k,
                        machine_tasks(machine.system),
                        if_covered=entrant in LEARNED,
                        machine=machine.name,
                    )

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        reach, _ = scale_of(MACHINES[str(question.labels["machine"])].system)
        (row,) = super().rows(question, answer)
        return [
            {
                **row,
                "relative_error": row["terminal_error"] / reach,
                "relative_gap": row["gap"] / reach,
                "arrives": row["gap"] <= ARRIVAL,
            }
        ]

    def report(self, data: pd.DataFrame) -> Parts:
        size = self.size
        within = data[data.reachable]
        cases = cases_of(within, taking_part(data, ENTRANTS), num_candidates=size.budgets)
        learned = data[data.entrant == DIFFUSION.label].machine.unique()
        yield (
            f"{size.tasks} random tasks on each machine, the same for all methods, and in "
            f"proportion the same on all machines. The reach is half of the width between where "
            f"full control to either side leads from rest within the {DEFAULT_HORIZON} steps of "
            "the horizon, the speed half of the difference between the velocities there. Targets "
            f"are up to {FARTHEST:g} of the reach away; half of the starts and a quarter of the "
            f"targets move, with up to {FASTEST:g} of the speed; the rest is at rest. "
            "Tasks whose target no control reaches are left out of all that follows. Errors and "
            "gaps to the floor are shown as shares of the reach; a plan arrives if its gap is at "
            f"most {ARRIVAL:g} in the machine's units. {DIFFUSION.label} takes part where a model "
            f"covers the machine ({', '.join(learned) or 'on none'}), {PAPER_DIFFUSION.label} on "
            "the paper's plant alone. Delays of actuators are not part of these tasks."
        )
        yield _picture(within, size.budgets)
        yield _machines(data)
        yield _arrivals(cases)
        for machine in MACHINES.values():
            if len(part := within[within.machine == machine.name]):
                yield _errors(part, machine, size.budgets)
        yield grid.of_cases(
            "The service's compute time for a plan (ms): medians over the reachable tasks.",
            cases,
            *_by_machine(lambda case: f"{np.median(case.values('compute_ms')):.1f}"),
            part="time",
        )
        yield _refined_arrive(within, size.budgets[0])
        if set(learned) == set(within.machine):
            yield _nearest_unrefined(within, size.budgets[0])


def _by_machine(cell: Callable[[Case], str]) -> Iterator[grid.Column[Case]]:
    """Show a case on each machine, nothing where it has no rows."""
    return (grid.elsewhere(machine, cell, machine=machine) for machine in MACHINES)


def _arrivals(cases: list[Case]) -> Table:
    return grid.of_cases(
        f"Share of the reachable tasks on which the plan arrives: a gap of at most {ARRIVAL:g}.",
        cases,
        *_by_machine(lambda case: percent(case.mean("arrives"), 1)),
    )


def _machines(data: pd.DataFrame) -> Table:
    tasks = data.drop_duplicates(["machine", "task"]).groupby("machine").reachable

    def counted(machine: Machine) -> str:
        reachable = tasks.get_group(machine.name)
        return f"{reachable.sum()} of {len(reachable)}"

    return grid.table(
        "The machines: how long the horizon is, what is within reach, and how many of the targets.",
        MACHINES.values(),
        (
            grid.Column("Machine", lambda machine: machine.name),
            grid.Column(
                "Horizon (s)", lambda machine: f"{DEFAULT_HORIZON * machine.system.time_step:.2f}"
            ),
            grid.Column("Unit", lambda machine: machine.position_unit),
            grid.Column("Reach", lambda machine: f"{scale_of(machine.system).reach:.3f}"),
            grid.Column("Speed (1/s)", lambda machine: f"{scale_of(machine.system).speed:.3f}"),
            grid.Column("Reachable", counted),
        ),
        part="machines",
    )


def _errors(data: pd.DataFrame, machine: Machine, budgets: tuple[int, ...]) -> Table:
    return grid.of_cases(
        f"`{machine.name}`, {machine.title}: error over the reach, mean ± standard deviation over "
        f"the {data.task.nunique()} reachable tasks, and the mean of the paired differences to CEM "
        "with its 95 % bootstrap interval; and the mean gap over the reach.",
        cases_of(data, taking_part(data, ENTRANTS), num_candidates=budgets),
        grid.spread("Error", "relative_error", 4),
        grid.less(f"Less {CEM.label}", "relative_error", CEM, digits=4),
        grid.Column("Gap", lambda case: f"{case.mean('relative_gap'):.1e}"),
        part=machine.name.replace("_", "-"),
    )


def _refined_arrive(within: pd.DataFrame, k: int) -> Claim:
    case = Case(within, REFINED_PRIOR, {"num_candidates": k})
    found = ", ".join(
        f"{name} {rows.arrives.sum()} of {len(rows)}, at most {rows.gap.max():.1e}"
        for name, rows in case.rows.groupby("machine", sort=False)
    )
    return Claim(
        f"Refined plans end on the floor on every machine (beyond the paper): {REFINED_PRIOR.label}"
        f", K = {k}, within {ARRIVAL:g} on every reachable task.",
        bool(case.rows.arrives.all()),
        f"Plans that arrive, and the largest gap: {found}.",
    )


def _nearest_unrefined(within: pd.DataFrame, k: int) -> Claim:
    """Claim that Action Diffusion leads the next method on every machine, in pairs."""
    differences, shown = [], []
    for name, data in within.groupby("machine", sort=False):
        rivals = [
            entrant
            for entrant in taking_part(data, ENTRANTS)
            if entrant != DIFFUSION and "refine" not in entrant.fields
        ]
        leader, *others = cases_of(data, [DIFFUSION, *rivals], num_candidates=(k,))
        next_best = min(others, key=lambda case: case.mean("relative_error"))
        difference = leader.less(next_best, "relative_error")
        differences.append(difference)
        shown.append(f"{name} {difference.shown(4, '+')} ({next_best.entrant.label})")
    return Claim(
        f"Of the plans that are not refined {DIFFUSION.label}'s end nearest on every machine, "
        f"K = {k} (beyond the paper).",
        all(difference.high < 0 for difference in differences),
        f"Mean error over the reach, less the next method's: {', '.join(shown)}.",
    )


def _drawn(values: NDArray[np.float64]) -> Interval:
    """Return the mean and its interval, nothing where there are no tasks."""
    if not values.size:
        return Interval(np.nan, np.nan, np.nan)
    return interval(values.clip(plots.LEAST_ERROR))


def _picture(within: pd.DataFrame, budgets: tuple[int, ...]) -> Picture:
    figure = new_figure(1.0 + 2.0 * len(budgets))
    panels = figure.subplots(len(budgets), sharex=True, sharey=True, squeeze=False)[:, 0]
    # Machines follow each other in no order that a line could stand for.
    unjoined = [replace(each, look=each.look._replace(ls="none")) for each in ENTRANTS]
    for axes, k in zip(panels, budgets, strict=True):
        cases = cases_of(within, unjoined, machine=list(MACHINES), num_candidates=(k,))
        lines = plots.entrant_lines(cases, "relative_error", _drawn)
        plots.draw_lines(axes, lines, range(len(MACHINES)), WIDTH)
        axes.set(title=f"K = {k}", yscale="log", ylabel="error over the reach")
    panels[-1].set_xticks(range(len(MACHINES)), labels=list(MACHINES))
    return plots.with_legend(
        figure,
        "Error over the reach on the reachable tasks of each machine: means with 95 % intervals; "
        "the methods stand side by side. What is below a millionth is drawn as that.",
    )
