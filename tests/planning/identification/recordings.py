"""Logs of the paper's plant and its like, for tests."""

import numpy as np

from app.evaluation.logs import Recording, draw_machine, record
from app.planning.arrays import FloatArray
from app.planning.identification.log import Log
from app.planning.identification.log_checks import checked_log
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, System
from tests.planning.between_samples import moved


def log_of(system: System, controls: FloatArray, noise: float = 0.0, delay_steps: int = 0) -> Log:
    """A log of a machine from rest, whose actuator has a delay."""
    acting = np.concatenate([np.zeros(delay_steps), controls])[: len(controls)]
    positions = rollout(system, np.zeros(2), acting[np.newaxis])[0, :, 0]
    errors = noise * np.random.default_rng(0).standard_normal(positions.size)
    return checked_log(system.time_step, controls, positions + errors)


def recorded(recording: Recording, number: int) -> tuple[System, Log]:
    """A machine of the evaluation's, and its log."""
    machine = draw_machine(recording, 1, number)
    request = record(recording, machine, 1, number)
    velocities = request.velocities
    return machine, checked_log(
        request.time_step,
        np.array(request.controls),
        np.array(request.positions),
        None if velocities is None else np.array(velocities),
    )


def truth(system: System, name: str) -> float:
    """What a parameter, named as identification names it, is in truth."""
    field, _, way = name.partition(".")
    value = getattr(system, field)
    return float(getattr(value, way or "forward") if isinstance(value, ByDirection) else value)


def positions_between_samples(system: System, controls: FloatArray) -> FloatArray:
    """Where a mass that moves on between its samples is at each of them (N+1,), m."""
    state = 0.0, 0.0
    positions = [0.0]
    for control in controls.tolist():
        state = moved(*state, control, system)
        positions.append(state[0])
    return np.array(positions)
