"""What runs of a machine were, and what they are worth."""

from dataclasses import dataclass

import numpy as np

from app.planning.arrays import BoolArray, FloatArray, IntArray
from app.planning.metrics import POSITION_TOLERANCE, control_energy
from app.planning.plant.system import System

HUNTING_WINDOW, HUNTING_STEPS = 32, 8
"""A run that moves in so many of its last steps hunts."""


@dataclass(frozen=True, slots=True)
class Runs:
    """N runs of T steps."""

    system: System
    """The true one."""
    target_position: float
    """m."""
    states: FloatArray
    """(N, T+1, 2), the true ones."""
    measurements: FloatArray
    """(N, T+1, 2); velocities NaN where they were not measured."""
    estimates: FloatArray
    """(N, T, 2): what the observer made of them."""
    controls: FloatArray
    """(N, T), as they were asked for."""
    statuses: IntArray
    """(N, T)."""

    @property
    def errors(self) -> FloatArray:
        """Distances |p - p*| from the target, (N, T+1), m."""
        return np.asarray(np.abs(self.states[..., 0] - self.target_position))

    @property
    def final_errors(self) -> FloatArray:
        """Of the last states, (N,), m."""
        return np.asarray(self.errors[:, -1])

    def are_inside(self, step: int) -> BoolArray:
        """Return which runs are within 1 cm and 1 cm/s of rest at the target at a step, (N,)."""
        slow = np.abs(self.states[:, step, 1]) < POSITION_TOLERANCE
        return np.asarray((self.errors[:, step] < POSITION_TOLERANCE) & slow)

    @property
    def settling_steps(self) -> IntArray:
        """The first step from which a run stays within 1 cm of the target, T + 1 if none; (N,)."""
        outside = self.errors >= POSITION_TOLERANCE
        last = outside.shape[1] - np.argmax(outside[:, ::-1], axis=1)
        return np.asarray(np.where(outside.any(axis=1), last, 0))

    @property
    def moving_steps(self) -> IntArray:
        """In how many of the last 32 steps a mass moved, (N,)."""
        speeds = np.abs(self.states[:, 1:, 1][:, -HUNTING_WINDOW:])
        return np.asarray(np.sum(speeds >= self.system.velocity_threshold, axis=1))

    @property
    def hunting(self) -> BoolArray:
        """Which runs hunt: they move in 8 or more of their last 32 steps, (N,)."""
        return np.asarray(self.moving_steps >= HUNTING_STEPS)

    @property
    def energies(self) -> FloatArray:
        """Control energies, (N,), in squared units of control."""
        return control_energy(self.controls)
