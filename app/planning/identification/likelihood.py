"""How likely a log is on many plants at once: the Kalman filter's one-step prediction errors."""

from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.identification.measurement_update import update_position, update_velocity
from app.planning.identification.stick_slip_filter import mean_state, predict, started
from app.planning.uncertainty.ensemble import Scenarios, scenario


class Record(NamedTuple):
    """A log as the kernel takes it; control k acts between the samples k and k+1."""

    controls: FloatArray
    """(N,), units of control, those that act."""
    positions: FloatArray
    """(N+1,), m."""
    velocities: FloatArray
    """(N+1,), m/s; (0,) where there are none."""
    position_lag: float
    """s: measured positions are those of so long ago."""
    stride: int
    """Of so many samples one is taken as a measurement."""
    initial_velocity: float
    """m/s, roughly."""
    initial_deviation: float
    """m/s: how rough that is."""


@compiled
def log_likelihoods(
    scenarios: Scenarios, noises: FloatArray, record: Record, num_blocks: int
) -> FloatArray:
    """Return the log-likelihoods of a log on every plant, by blocks of its steps.

    Args:
        scenarios: the plants (S, parameters); states and target are not looked at.
        noises: (S, 3), standard deviations of the random acceleration (m/s^2), of measured
            positions (m) and velocities (m/s).
        record: the log.
        num_blocks: B, at most N.

    Returns:
        (S, 5, B), of each block: the log-likelihood, the mean probability of rest, the sum of the
        squared prediction errors of positions (m^2), and the mean position (m) and velocity (m/s)
        at its end.
    """
    num_steps = record.controls.size
    result = np.zeros((len(noises), 5, num_blocks))
    with_velocities = record.velocities.size > 0
    for s in range(len(noises)):
        plant = scenario(scenarios, s).plant
        noise, position_noise, velocity_noise = noises[s, 0], noises[s, 1], noises[s, 2]
        belief = started(
            record.positions[0],
            record.position_lag,
            position_noise,
            record.initial_velocity,
            record.initial_deviation,
        )
        for k in range(num_steps):
            belief = predict(belief, record.controls[k], plant, noise)
            block = k * num_blocks // num_steps
            if (k + 1) % record.stride == 0:
                measured, lag = record.positions[k + 1], record.position_lag
                position, velocity = mean_state(belief)
                result[s, 2, block] += (measured - (position - lag * velocity)) ** 2
                belief, likely = update_position(belief, measured, position_noise, lag)
                result[s, 0, block] += likely
                if with_velocities:
                    measured = record.velocities[k + 1]
                    belief, likely = update_velocity(belief, measured, velocity_noise)
                    result[s, 0, block] += likely
            result[s, 1, block] += belief.rest.probability * num_blocks / num_steps
            result[s, 3, block], result[s, 4, block] = mean_state(belief)
    return result
