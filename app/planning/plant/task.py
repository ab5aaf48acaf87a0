"""The task of a problem as the kernels take it."""

from typing import NamedTuple

from app.planning.plant.system import Plant


class Task(NamedTuple):
    """From a state to a target, m and m/s, on a plant."""

    position: float
    velocity: float
    target_position: float
    target_velocity: float
    plant: Plant
