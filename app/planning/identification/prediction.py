"""What a plant predicts of a log: step by step through the filter, and windows ahead without it."""

from dataclasses import dataclass

import numpy as np

from app.planning.arrays import FloatArray, IntArray
from app.planning.identification.likelihood import Record, log_likelihoods
from app.planning.identification.log import Log
from app.planning.plant.rollout import rollout_on
from app.planning.plant.system import Plant
from app.planning.uncertainty.ensemble import Scenarios

WINDOW_SECONDS = 0.5
LEAST_WINDOWS = 4
LEAST_WINDOW_STEPS = 5


@dataclass(frozen=True, slots=True)
class Trace:
    """The filter's belief after each step, (N,) each."""

    rest: FloatArray
    """Probability of rest."""
    squared_errors: FloatArray
    """Of the predicted positions, m^2; 0 where none was measured."""
    positions: FloatArray
    """m."""
    velocities: FloatArray
    """m/s."""


def trace(plant: FloatArray, noises: FloatArray, record: Record) -> Trace:
    """Return what the filter makes of a log.

    Args:
        plant: (parameters,), the fields of `Plant`.
        noises: (3,), as `log_likelihoods` takes them.
        record: the log.
    """
    scenarios = Scenarios(np.ascontiguousarray(plant[np.newaxis]), np.zeros((1, 2)), 0.0, 0.0)
    steps = record.controls.size
    noises = np.ascontiguousarray(noises[np.newaxis])
    _, rest, squared_errors, positions, velocities = log_likelihoods(
        scenarios, noises, record, steps
    )[0]
    return Trace(rest, squared_errors, positions, velocities)


@dataclass(frozen=True, slots=True)
class Windows:
    """Stretches of a log, one after the other, each predicted from the belief at its start."""

    starts: IntArray
    """(W,), indices of samples."""
    positions: FloatArray
    """(W, H+1), as they would be measured, m."""
    errors: FloatArray
    """(W, H+1): predicted less measured, m."""
    moved: FloatArray
    """(W,): from the first measurement to the last, m."""

    @classmethod
    def of(
        cls, plant: Plant, log: Log, believed: Trace, seconds: float = WINDOW_SECONDS
    ) -> "Windows":
        """Predict the windows of a log whose controls act at once.

        Args:
            plant: that predicts.
            log: at least `LEAST_WINDOWS` windows long, or windows are shorter.
            believed: what the filter made of the log.
            seconds: how long windows are.
        """
        most = log.num_steps // LEAST_WINDOWS
        steps = max(LEAST_WINDOW_STEPS, min(round(seconds / log.time_step), most))
        starts = np.arange(steps, log.num_steps - steps + 1, steps)
        # The belief after step k is that at sample k+1.
        states = np.column_stack([believed.positions[starts - 1], believed.velocities[starts - 1]])
        samples = starts[:, np.newaxis] + np.arange(steps + 1)
        states = rollout_on(plant, states, log.controls[samples[:, :-1]])
        positions = states[:, :, 0] - log.position_lag * states[:, :, 1]
        measured = log.positions[samples]
        return cls(starts, positions, positions - measured, measured[:, -1] - measured[:, 0])

    @property
    def r2(self) -> float:
        """Share of the variance of what the machine moves in a window that is predicted."""
        moved = max(float(np.mean(self.moved**2)), 1e-300)
        return 1.0 - float(np.mean(self.errors[:, -1] ** 2)) / moved

    @property
    def steps(self) -> int:
        """H."""
        return len(self.positions[0]) - 1
