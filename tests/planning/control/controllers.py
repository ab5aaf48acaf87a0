"""Controllers to test with, and an exact sensor's observer."""

import numpy as np

from app.planning.control import CONTROLLERS, AnyController
from app.planning.control.observer import Observer
from app.planning.control.runs import Runs
from app.planning.control.simulation import (
    Controls,
    Disturbance,
    Sensor,
    ToldOf,
    TrueMachine,
    simulate,
)
from app.planning.plant.system import System

EXACT = Observer(position_noise=0.0, velocity_noise=0.0, acceleration_noise=0.002)
OFF = System(0.78, 0.66, 0.045, control_gain=0.97)
"""A plant that the default model is off from by 10 %."""
EVERY_CONTROLLER: list[AnyController] = [kind() for kind in CONTROLLERS]


def run(
    controller: AnyController | Controls,
    *,
    truth: System = OFF,
    start: tuple[float, float] = (0.0, 0.0),
    target: float = 0.3,
    model: System | None = None,
    steps: int = 128,
    deadline: int | None = 64,
    disturbance: Disturbance | None = None,
    sensor: Sensor | None = None,
    delay_steps: int = 0,
    of_delay: bool = True,
    seeds: int = 1,
) -> Runs:
    """Run a controller on a plant that is off from its model."""
    return simulate(
        TrueMachine(truth, disturbance or Disturbance(), sensor or Sensor(), delay_steps),
        np.array(start),
        controller,
        ToldOf(model or System(), target, deadline, of_delay),
        steps,
        range(seeds),
    )
