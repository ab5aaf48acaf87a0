"""Machines from their logs: what is found of simulated ones, how sure it is, and what it is for."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from pydantic import TypeAdapter

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import cases_of
from app.evaluation.logs import FRICTION_SHARE, GAIN_SHARE, Recording, draw_machine, record
from app.evaluation.question import Entrant, Question
from app.evaluation.statistics import interval, percent
from app.evaluation.suite import Claim, Parts, Picture, Row, Size, Suite
from app.evaluation.tasks import Task, reachable_tasks
from app.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY, Look, new_figure
from app.planning.methods import DatasetPrior
from app.planning.planner import plan
from app.planning.plant.system import ByDirection, System
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.uncertainty import Uncertainty

STANDARD = Entrant("1000 steps", {}, Look(BLUE, "o", "-"))
RECORDINGS: dict[Entrant, Recording] = {
    STANDARD: Recording(),
    Entrant("500 steps", {}, Look(SKY, "v", "--")): Recording(num_steps=500),
    Entrant("2000 steps", {}, Look(GREEN, "^", "-")): Recording(num_steps=2000),
    Entrant("ramps and dwells", {}, Look(ORANGE, "s", "-")): Recording("ramps"),
    Entrant("with velocities", {}, Look(PINK, "P", "--")): Recording(velocity_noise=1e-2),
    Entrant("pushed at random", {}, Look(RED, "X", ":")): Recording(acceleration_noise=0.1),
    Entrant("by direction", {}, Look(GREY, "D", ":")): Recording(by_direction=True),
    Entrant("between samples", {}, Look(BLACK, "*", "--")): Recording(between_samples=True),
}
"""How the logs of each are recorded."""
PARAMETERS = {
    "coulomb_friction": "Coulomb (m/s²)",
    "static_friction": "Static (m/s²)",
    "control_gain": "Gain",
    "viscous_damping": "Damping (1/s)",
}
MOST_COULOMB_ERROR = 0.004
"""m/s^2, median."""
LEAST_COVERED, MOST_COVERED = 0.90, 0.98
MOST_PLAN_ERROR = 0.01
"""m, mean."""
NUM_PLANS = 2
"""With each machine that was found."""
LEAST, LARGEST = 1e-5, 1e-1
"""m/s^2: the figure's edges."""
SYSTEM = TypeAdapter(System)


class Identification(Suite):
    """Simulated machines identified from logs of their positions."""

    name = "identification"
    title = "Machines identified from logs"
    FULL = Size(budgets=(), tasks=60, entrants=tuple(RECORDINGS))
    QUICK = Size(budgets=(), tasks=2, entrants=(STANDARD,))

    def questions(self) -> Iterator[Question]:
        for entrant in self.size.entrants:
            recording = RECORDINGS[entrant]
            for task in range(self.size.tasks):
                machine = draw_machine(recording, self.seed, task)
                log = record(recording, machine, self.seed, task)
                yield Question({"entrant": entrant.label, "task": task, "run": 0}, log)

    @property
    def _num_logs(self) -> int:
        return len(self.size.entrants) * self.size.tasks

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Compare what was found with what is true, and carry out plans made with it."""
        label, task = question.labels["entrant"], int(question.labels["task"])
        recording = next(r for entrant, r in RECORDINGS.items() if entrant.label == label)
        machine = draw_machine(recording, self.seed, task)
        content = answer.content
        row: dict[str, Any] = {**question.labels, "seconds": answer.compute_ms / 1e3}
        within, told = [], []
        for name in PARAMETERS:
            found = [p for p in content["parameters"] if p["name"].partition(".")[0] == name]
            errors = [abs(p["value"] - _true(machine, p["name"])) for p in found]
            row[name] = float(np.mean(errors))
            within += [_covers(p, _true(machine, p["name"])) for p in found]
            told += [p["identifiable"] for p in found]
        row |= {"covered": float(np.mean(within)), "told": float(np.mean(told))}
        lag = 0.5 * machine.time_step if recording.between_samples else 0.0
        row["timing_found"] = (content["delay_steps"], content["position_lag"]) == (0, lag)
        systems = {
            "planned": SYSTEM.validate_python(content["system"]),
            "nominal": System(),
            "knowing": machine,
        }
        tasks = reachable_tasks(NUM_PLANS * (task + 1), self.seed)[-NUM_PLANS:]
        for name, system in systems.items():
            row[name] = float(np.mean([*_plan_errors(system, machine, tasks)]))
        ensemble = [SYSTEM.validate_python(each) for each in content["systems"]]
        robust = _plan_errors(systems["planned"], machine, tasks, ensemble)
        row["robust"] = float(np.mean([*robust]))
        return [row]

    def report(self, data: pd.DataFrame) -> Parts:
        cases = cases_of(data, self.size.entrants)
        yield (
            f"{self.size.tasks} machines for each way of recording, around the paper's plant: "
            f"frictions and damping off by up to {percent(FRICTION_SHARE)}, the gain by up to "
            f"{percent(GAIN_SHARE)}. Positions have a noise of 1 mm, and nothing else is told but "
            "the time step and the control limit: delay, lag of the positions, bias and whether "
            "friction differs by direction are open, too. Controls are those of the paper's "
            "training data, or ramps and dwells as `breakaway identify --excitation` writes them. "
            "*With velocities* adds those, with a noise of 1 cm/s; *pushed at random* pushes the "
            "mass with 0.1 m/s² in each step; *by direction* draws another Coulomb friction "
            "backward, which a bias can stand for: there errors of the two are no errors of the "
            "motion; *between samples* moves as a machine does, not as the plant: positions are "
            "those of half a step ago. Logs of machines that hardly move tell nothing and are "
            f"refused: {self._num_logs - len(data)} of {self._num_logs}."
        )
        yield grid.of_cases(
            "Median absolute errors, the share of the 95 % intervals that hold the truth, and the "
            "service's time.",
            cases,
            *(grid.median(heading, name, 4) for name, heading in PARAMETERS.items()),
            grid.share("Covered", "covered", 1),
            grid.share("Timing found", "timing_found", 0),
            grid.median("Time (s)", "seconds", 2),
        )
        yield grid.of_cases(
            "Errors (m) of refined plans to targets at rest, carried out on the machine: made with "
            "the plant that was found, robust with the ensemble that was found, with the nominal "
            f"plant, and with the truth; {NUM_PLANS} plans each.",
            cases,
            grid.mean("Found, mean", "planned", 4),
            grid.median("Found, median", "planned", 4),
            grid.mean("Robust, mean", "robust", 4),
            grid.median("Robust, median", "robust", 4),
            grid.mean("Nominal, mean", "nominal", 4),
            grid.mean("Truth, mean", "knowing", 4),
            part="plans",
        )
        standard = cases[0]
        coulomb = float(np.median(standard.values("coulomb_friction")))
        yield Claim(
            f"1000 positions with 1 mm noise tell Coulomb friction to {MOST_COULOMB_ERROR:g} m/s² "
            "(median).",
            coulomb <= MOST_COULOMB_ERROR,
            f"Median error {coulomb:.4f} m/s².",
        )
        covered = standard.mean("covered")
        yield Claim(
            "95 % intervals hold the truth in 90 to 98 % of the cases.",
            LEAST_COVERED <= covered <= MOST_COVERED,
            f"{percent(covered, 1)} of those of {self.size.tasks} machines.",
        )
        planned, nominal = standard.mean("planned"), standard.mean("nominal")
        yield Claim(
            f"Plans made with what was found end within {MOST_PLAN_ERROR:g} m on average.",
            planned <= MOST_PLAN_ERROR,
            f"{planned:.4f} m, where the nominal plant has {nominal:.3f} m.",
        )
        robust = standard.mean("robust")
        less = interval(standard.values("robust") - standard.values("planned"))
        yield Claim(
            "Robust plans with the ensemble that was found end nearer than plans for the plant "
            "that was found.",
            less.high < 0.0,
            f"{robust:.4f} m on average, {less.shown(4, '+')} m of difference (95 % interval over "
            f"the machines); knowing the truth leaves {standard.mean('knowing'):.4f} m.",
        )
        yield self._picture(data)

    def _picture(self, data: pd.DataFrame) -> Picture:
        figure = new_figure(3.0)
        axes = figure.subplots()
        for case in cases_of(data, self.size.entrants):
            label = "error e of Coulomb friction (m/s²)"
            plots.draw_shares(axes, case, "coulomb_friction", LARGEST, label, LEAST)
        axes.set(title="", ylabel="share of machines within e")
        return plots.with_legend(
            figure, "Share of the machines whose Coulomb friction is found to within e."
        )


def _plan_errors(
    system: System, machine: System, tasks: Sequence[Task], ensemble: Sequence[System] = ()
) -> Iterator[float]:
    """Yield the errors of refined plans for a system, robust with an ensemble if there is one, that
    are carried out on the machine."""
    for number, each in enumerate(tasks):
        start, target = np.array(each["initial_state"]), np.array(each["target_state"])
        recipe = Recipe(DatasetPrior(), 16, Refinement())
        if ensemble:
            plants = Ensemble.of(ensemble, start)
            uncertainty = Uncertainty(plants, plants)
            # What is repaired is the motion of one plant.
            recipe = replace(recipe, refinement=Refinement(repair=False), uncertainty=uncertainty)
        made = plan(Problem(start, target, system), recipe, np.random.default_rng(number))
        controls = made.controls[np.newaxis]
        yield float(Ensemble.of([machine], start).errors(controls, target)[0, 0])


def _true(machine: System, name: str) -> float:
    """Return what a parameter is in truth."""
    field, _, way = name.partition(".")
    value = getattr(machine, field)
    return float(getattr(value, way or "forward") if isinstance(value, ByDirection) else value)


def _covers(parameter: Mapping[str, Any], truth: float) -> bool:
    low, high = parameter["interval"]
    return bool(low <= truth <= high)
