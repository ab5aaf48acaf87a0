"""Closed loops on plants that are off, undisturbed and disturbed: controllers beside open loops."""

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from app.evaluation import grid
from app.evaluation.answer_log import Answer
from app.evaluation.case import cases_of, taking_part
from app.evaluation.circumstances import CIRCUMSTANCES, STEPS, UNDISTURBED
from app.evaluation.closed_machines import (
    machine_questions,
    machine_report,
    taking_part_on_machines,
)
from app.evaluation.controllers import (
    CLOSED,
    LAWS,
    RECEDING,
    RECEDING_IDENTIFYING,
    SWITCHING,
    tuned,
)
from app.evaluation.entrants import REFINED_PRIOR
from app.evaluation.question import Entrant, Question
from app.evaluation.run_measures import KEPT, MIDWAY, columns, measures, measures_of
from app.evaluation.statistics import percent
from app.evaluation.suite import Parts, Picture, Row, Size, Suite
from app.evaluation.suites.robust import ROBUST, shares_of
from app.evaluation.tasks import Task, reachable_tasks, request_seed
from app.figures.style import new_figure
from app.planning.control.estimate import system_of
from app.planning.control.runs import Runs
from app.planning.control.simulation import Controls, ToldOf, TrueMachine, simulate
from app.planning.metrics import POSITION_TOLERANCE
from app.planning.plant.system import Plant, System
from app.wire.requests import PlanRequest
from app.wire.simulation import SimulateRequest

NUM_PLANTS = 5
"""Of each task."""
SHARES = (0.1, 0.2)
"""How far each friction parameter may be off; disturbances are met by plants within the larger."""
OPEN = (
    Entrant("Open loop", REFINED_PRIOR.fields, REFINED_PRIOR.look),
    Entrant("Robust open loop", REFINED_PRIOR.fields, ROBUST.look),
)
SHOWN = (*OPEN, RECEDING, RECEDING_IDENTIFYING)
"""In the figure."""
SHOWN_TASKS = 1


class Cell(NamedTuple):
    """Plants within a share of the model, and what disturbs them."""

    share: float
    circumstances: str


CELLS = (
    *(Cell(share, "none") for share in SHARES),
    *(Cell(SHARES[-1], name) for name, given in CIRCUMSTANCES.items() if given != UNDISTURBED),
)


class ClosedLoop(Suite):
    """Controllers on machines that are not the model, disturbed or real ones."""

    name = "closed-loop"
    title = "Closed loops on plants that are off, and disturbed"
    draw_tasks = staticmethod(reachable_tasks)
    FULL = Size(budgets=(16,), tasks=60, runs=NUM_PLANTS, entrants=(*OPEN, *CLOSED))
    QUICK = Size(
        budgets=(16,), tasks=2, runs=2, entrants=(*OPEN, SWITCHING, RECEDING, RECEDING_IDENTIFYING)
    )

    def questions(self) -> Iterator[Question]:
        tasks = reachable_tasks(self.size.tasks, self.seed)
        for cell, entrant in product(CELLS, self.size.entrants):
            labels: dict[str, str | int | float] = {
                "off_by": cell.share,
                "circumstances": cell.circumstances,
                "entrant": entrant.label,
            }
            if entrant not in OPEN:
                yield from self._runs(tasks, entrant, cell, labels)
            elif cell.circumstances == "none":
                for number, task in enumerate(tasks):
                    request = _plan(entrant, cell, task, self.size.budgets[0], self._seed(number))
                    yield Question(labels | {"task": number}, request, trajectories=True)
        for entrant in taking_part_on_machines(self.size.entrants):
            yield from machine_questions(entrant, self.size.tasks, self.seed)

    def _runs(
        self, tasks: list[Task], entrant: Entrant, cell: Cell, labels: dict[str, str | int | float]
    ) -> Iterator[Question]:
        """Ask for a run of a controller on each plant of each task."""
        given = CIRCUMSTANCES[cell.circumstances]
        controller, steps_left = tuned(entrant, cell.circumstances)
        for number, task in enumerate(tasks):
            is_shown = entrant in SHOWN and cell.circumstances == "none" and number < SHOWN_TASKS
            for run, system in enumerate(self._plants(cell.share, number)):
                request = SimulateRequest.model_validate(
                    {
                        **task,
                        "system": system,
                        "nominal_system": System(),
                        "controller": controller,
                        "steps": STEPS,
                        "steps_left": steps_left,
                        "disturbance": {
                            "acceleration_noise": given.disturbance.acceleration_noise,
                            "pulses": list(given.disturbance.pulses),
                        },
                        "sensor": given.sensor,
                        "delay_steps": given.delay_steps,
                        "seed": self._seed(number, run),
                        "include": ["states"],
                    }
                )
                kept = tuple(range(STEPS + 1)) if is_shown else KEPT
                yield Question(labels | {"task": number, "run": run}, request, kept_steps=kept)

    def _plants(self, share: float, task: int) -> list[System]:
        """Draw the true plants of a task, the same for everybody."""
        rng = np.random.default_rng([self.seed, task])
        rows = shares_of(share).draw(System(), NUM_PLANTS, rng)[: self.size.runs]
        return [system_of(Plant(*row)) for row in rows.tolist()]

    def _seed(self, task: int, run: int = 0) -> int:
        return request_seed(self.seed, task, run)

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Measure a run; or carry a plan out on the plants of its task."""
        labels, request = question.labels, question.request
        if isinstance(request, SimulateRequest):
            return [{**labels, **measures_of(question, request, answer)}]
        assert isinstance(request, PlanRequest)
        return [
            {**labels, "run": number, **self._open_loop(request, system, answer)}
            for number, system in enumerate(
                self._plants(float(labels["off_by"]), int(labels["task"]))
            )
        ]

    def _open_loop(self, request: PlanRequest, system: System, answer: Answer) -> dict[str, Any]:
        """Carry a plan out without looking, and measure that."""
        target = request.target_state[0]
        controls = Controls(np.array(answer.content["controls"]))
        runs: Runs = simulate(
            TrueMachine(system),
            request.initial_state,
            controls,
            ToldOf(System(), target),
            STEPS,
            [0],
        )
        states = runs.states[0]
        settling, hunting = int(runs.settling_steps[0]), bool(runs.hunting[0])
        energy = float(runs.energies[0])
        step = System().time_step
        measured = measures(
            states[MIDWAY], states[-1], target, settling * step, hunting=hunting, energy=energy
        )
        return measured | {"us": np.nan, "states": states}

    def report(self, data: pd.DataFrame) -> Parts:
        yield (
            f"{self.size.tasks} random starts with targets at rest that are within reach of the "
            f"model in {MIDWAY} steps, {self.size.runs} true plants of each, which are off by up "
            "to so much; not every one of them can be there by then. All controllers look through "
            "the same sensors, are told of noise and delay as they are, and have settings that a "
            "search found on other tasks and plants, for each disturbance apart: "
            "`python -m tests.tune_controllers`."
        )
        for cell in CELLS:
            chosen = data[(data.off_by == cell.share) & (data.circumstances == cell.circumstances)]
            title = CIRCUMSTANCES[cell.circumstances].title
            what = "undisturbed" if cell.circumstances == "none" else title
            yield grid.of_cases(
                f"Friction off by up to {percent(cell.share)}, {what}: error after {MIDWAY} steps "
                f"(mm), the share of the runs that rest within {POSITION_TOLERANCE:g} m by then "
                f"and its paired difference to that of {SWITCHING.label}, with the 95 % bootstrap "
                f"interval over the tasks; the same after {STEPS} steps; settling time, share that "
                "hunts, energy, and the service's time for a step (µs).",
                cases_of(chosen, taking_part(chosen, self.size.entrants)),
                *columns(grid.less("Less the law", "midway_inside", SWITCHING, 3)),
                part=f"{round(100 * cell.share)}-{cell.circumstances}",
            )
        yield from machine_report(data, self.size)
        yield self._laws(data)
        yield self._picture(data)

    def _laws(self, data: pd.DataFrame) -> str:
        """Say where receding horizon wins, and where a law does as well."""
        undisturbed = data[(data.off_by == SHARES[-1]) & (data.circumstances == "none")]
        laws = cases_of(undisturbed, taking_part(undisturbed, LAWS))
        best = max(laws, key=lambda case: case.mean("midway_inside"))
        ours = best.with_entrant(RECEDING_IDENTIFYING)
        less = ours.less(best, "midway_inside")
        saved = 1.0 - ours.mean("energy") / best.mean("energy")
        return (
            f"Undisturbed, off by up to {percent(SHARES[-1])}, {ours.entrant.label} is inside at "
            f"step {MIDWAY} in {percent(ours.mean('midway_inside'), 1)} of the runs and "
            f"{best.entrant.label}, the best of the laws, in "
            f"{percent(best.mean('midway_inside'), 1)} (paired difference {less.shown(3, '+')}); "
            f"it takes {percent(saved)} less energy, and settles in "
            f"{np.median(ours.values('settling_s')):.2f} s where the law needs "
            f"{np.median(best.values('settling_s')):.2f} s."
        )

    def _picture(self, data: pd.DataFrame) -> Picture:
        figure = new_figure(2.2)
        panels = figure.subplots(1, len(SHOWN), sharey=True)
        task = reachable_tasks(1, self.seed)[0]
        times = System().time_step * np.arange(STEPS + 1)
        shown = data[
            (data.off_by == SHARES[-1]) & (data.circumstances == "none") & (data.task == 0)
        ]
        for axes, entrant in zip(panels, SHOWN, strict=True):
            for states in shown[shown.entrant == entrant.label].states:
                axes.plot(times, states[:, 0], color=entrant.look.color, lw=0.8)
            axes.axhline(task["target_state"][0], color="k", lw=0.5, ls=":")
            axes.axvline(times[MIDWAY], color="k", lw=0.5, ls=":")
            axes.set_title(entrant.label, fontsize="small")
            axes.set_xlabel("time (s)")
        panels[0].set_ylabel("position (m)")
        return Picture(
            f"Runs of the first task on {self.size.runs} plants that are off by up to "
            f"{percent(SHARES[-1])}: target and deadline dotted.",
            figure,
        )


def _plan(entrant: Entrant, cell: Cell, task: Task, num_candidates: int, seed: int) -> PlanRequest:
    """Return the request for an open loop: a nominal plan, or one for all that may be."""
    asking = entrant
    if entrant == OPEN[1]:
        asking = entrant.asking(uncertainty={"relative": shares_of(cell.share)})
    request = asking.request(task, num_candidates, seed)
    assert isinstance(request, PlanRequest)
    return request
