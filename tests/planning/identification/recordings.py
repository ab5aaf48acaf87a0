"""Logs of the paper's plant and its like, for tests."""

import math

import numpy as np

from app.evaluation.logs import Recording, draw_machine, record
from app.planning.arrays import FloatArray
from app.planning.identification.log import Log
from app.planning.identification.log_checks import checked_log
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, System


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


SUBSTEPS = 200


def positions_between_samples(system: System, controls: FloatArray) -> FloatArray:
    """Where a mass of equal frictions both ways is at each sample (N+1,), m, by Newton's law.

    It moves on between the samples, under a control that is held, as a machine does and the plant
    does not: the velocity of a step is the mean of those before and after.
    """
    plant, step = system.plant, system.time_step / SUBSTEPS
    position = velocity = 0.0
    positions = [position]
    for control in controls.tolist():
        force = plant.control_gain * control + plant.bias
        for _ in range(SUBSTEPS):
            if velocity == 0.0 and abs(force) <= plant.static_forward:
                break
            way = velocity if velocity != 0.0 else force
            friction = math.copysign(plant.coulomb_forward, way)
            after = velocity + step * (force - friction - plant.damping_forward * velocity)
            if after * way <= 0.0:
                after = 0.0
            position += 0.5 * step * (velocity + after)
            velocity = after
        positions.append(position)
    return np.array(positions)
