"""A machine that moves on between its samples: it arrives, and stays."""

import numpy as np
import pytest

from app.planning.control import RecedingHorizon
from app.planning.control.observer import Observer
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.system import System
from tests.planning.between_samples import moved

AXIS = System(1.28, 1.02, 0.4, control_gain=0.45, control_limit=8.0, time_step=0.02)
COUNT = 1e-4
"""Of its encoder, m."""
STEPS, LAST = 200, 50


def driven(observer: Observer, target: float) -> tuple[float, int]:
    """How far from the target it ends, m, and in how many of the last steps it moved."""
    controller = RecedingHorizon(observer=observer)
    state, memory, moving = (0.0, 0.0), None, 0
    for k in range(STEPS):
        measured = Measurement(COUNT * round(state[0] / COUNT))
        taken = control_step(controller, AXIS, measured, Goal(target), memory)
        memory, before = taken.memory, state[0]
        state = moved(*state, taken.control, AXIS)
        moving += k >= STEPS - LAST and state[0] != before
    return abs(state[0] - target), moving


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_told_of_the_lag_it_arrives_and_stays(noise: float) -> None:
    observer = Observer(position_noise=noise, position_step=COUNT, position_lag=0.01)
    for target in np.linspace(-0.3, 0.3, 12).tolist():
        error, moving = driven(observer, target)
        assert error < 4e-4
        assert moving == 0


def test_a_brake_that_would_turn_it_round_is_weaker() -> None:
    """The plant stops for the rest of a step whatever the brake: a machine does not."""
    velocity = 0.05
    position, _ = moved(0.0, velocity, -8.0, AXIS)
    controller = RecedingHorizon(observer=Observer(position_noise=0.0, position_lag=0.01))
    measured = Measurement(0.0, velocity)

    taken = control_step(controller, AXIS, measured, Goal(3e-4))
    stopped, slow = moved(0.0, velocity, taken.control, AXIS)

    assert abs(slow) < 1e-3
    assert stopped > position
