"""Closed loops on real machines, of which less is believed than was published of them."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from app.evaluation import grid
from app.evaluation.case import cases_of, taking_part
from app.evaluation.circumstances import STEPS
from app.evaluation.controllers import (
    RECEDING,
    RECEDING_IDENTIFYING,
    RECEDING_SAVING,
    SWITCHING,
    SWITCHING_IDENTIFYING,
    tuned,
)
from app.evaluation.question import Entrant, Question
from app.evaluation.run_measures import KEPT, MIDWAY, columns
from app.evaluation.suite import Parts, Size
from app.evaluation.tasks import machine_tasks, request_seed
from app.planning.plant.machines import MACHINES, Machine
from app.planning.plant.system import ByDirection, System
from app.planning.problem import Problem
from app.planning.reachable.reachability import reachability
from app.wire.simulation import SimulateRequest

REAL = tuple(machine for machine in MACHINES.values() if machine.name != "paper")
WITHOUT_SCALE = (SWITCHING, SWITCHING_IDENTIFYING, RECEDING, RECEDING_IDENTIFYING, RECEDING_SAVING)
"""Gains of the other laws are made for one machine's scale of time."""


def taking_part_on_machines(entrants: Sequence[Entrant]) -> list[Entrant]:
    """Return those of `entrants` whose settings mean the same on every machine."""
    return [entrant for entrant in entrants if entrant in WITHOUT_SCALE]


def believed_of(system: System) -> System:
    """Return what a simple model has of a machine: friction the same both ways, and weight."""
    return System(
        static_friction=_mean(system.static_friction),
        coulomb_friction=_mean(system.coulomb_friction),
        viscous_damping=_mean(system.viscous_damping),
        bias=system.bias,
        control_gain=system.control_gain,
        control_limit=system.control_limit,
        time_step=system.time_step,
        velocity_threshold=system.velocity_threshold,
    )


def _mean(friction: float | ByDirection) -> float:
    if isinstance(friction, ByDirection):
        return float(np.mean([friction.forward, friction.backward]))
    return friction


def machine_questions(entrant: Entrant, num_tasks: int, seed: int) -> Iterator[Question]:
    """Ask for a run of each task on each machine."""
    for machine in REAL:
        controller, steps_left = tuned(entrant, "delay" if machine.delay_steps else "none")
        for number, (start, target) in enumerate(_tasks(machine, num_tasks, seed)):
            request = SimulateRequest(
                initial_state=start,
                target_state=(target, 0.0),
                system=machine.system,
                nominal_system=believed_of(machine.system),
                controller=controller,
                steps=STEPS,
                steps_left=steps_left,
                delay_steps=machine.delay_steps,
                seed=request_seed(seed, number, 0),
                include=["states"],
            )
            labels: dict[str, str | int | float] = {
                "machine": machine.name,
                "entrant": entrant.label,
                "task": number,
                "run": 0,
            }
            yield Question(labels, request, kept_steps=KEPT)


def _tasks(
    machine: Machine, num_tasks: int, seed: int
) -> Iterator[tuple[tuple[float, float], float]]:
    """Yield starts and target positions, at rest there and within reach of the machine."""
    drawn = machine_tasks(machine.system)
    found, asked = 0, num_tasks
    while found < num_tasks:
        for task in drawn(asked, seed)[asked - num_tasks :]:
            start, (target, _) = task["initial_state"], task["target_state"]
            problem = Problem(np.array(start), np.array([target, 0.0]), machine.system)
            if found < num_tasks and reachability(problem).reachable:
                found += 1
                yield start, target
        asked += num_tasks


def machine_report(data: pd.DataFrame, size: Size) -> Parts:
    """Yield what came of the machines."""
    yield (
        f"Real machines as published (`breakaway models --machines`), {size.tasks} tasks on each: "
        "half of the starts move, targets rest, and are within half of what full control reaches "
        f"in {MIDWAY} steps. The controllers believe in friction that is the same both ways, the "
        "mean of both, and without Stribeck's effect; they are told of weight and delay where "
        "there are any. No setting was tuned for them: those take part whose settings mean the "
        "same on any machine, as they are tuned for the paper's plant."
    )
    for machine in REAL:
        chosen = data[data.machine == machine.name]
        yield grid.of_cases(
            f"`{machine.name}`, {machine.title}, a step of {1e3 * machine.system.time_step:g} ms"
            + (f", {machine.delay_steps} of delay" if machine.delay_steps else "")
            + f"; errors in thousandths of a {machine.position_unit}.",
            cases_of(chosen, taking_part(chosen, size.entrants)),
            *columns(),
            part=machine.name,
        )
