"""A log of a machine, and what is seen of its noise.

What cannot be a log of one machine in motion is refused in log_checks.py; what follows from one
that can be is for the others to say.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.identification.likelihood import Record

WINDOW_STARTS = 3
"""Steps over which the velocity at the start is looked at."""
NORMAL_MEDIAN = 0.6745
"""Of the absolute values of a normal distribution, in standard deviations."""
WHOLE = 0.01
"""Off a whole number of counts by less than that is no farther than digits go."""
FLOOR = 1e-7
"""Of the range of the positions: no sensor is taken for better."""


@dataclass(frozen=True, slots=True)
class Log:
    """What was done to a machine and what was measured, at even times.

    Control k acts from sample k to k+1, or a delay later. There is a position before each control
    and one after the last; velocities there are as many as positions, or none.
    """

    time_step: float
    """s."""
    controls: FloatArray
    """(N,), units of control."""
    positions: FloatArray
    """(N+1,), m."""
    velocities: FloatArray | None = None
    """As many as positions, m/s."""
    position_lag: float = 0.0
    """s: measured positions are those of so long ago, less the velocity for that time."""

    @property
    def num_steps(self) -> int:
        """N, the steps that were measured on both sides."""
        return len(self.controls)

    @property
    def duration(self) -> float:
        """From the first sample to the last, s."""
        return self.num_steps * self.time_step

    @property
    def position_noise(self) -> float:
        """A robust estimate of the noise of the positions: standard deviation, m."""
        return max(_noise_of(self.positions), self.least_noise)

    @property
    def velocity_noise(self) -> float | None:
        """The same of the velocities, m/s."""
        if self.velocities is None:
            return None
        return max(_noise_of(self.velocities), FLOOR * float(np.ptp(self.velocities)))

    @property
    def least_noise(self) -> float:
        """Of positions that are whole numbers of an encoder's counts, and of any other: m."""
        return max(self.resolution / math.sqrt(12.0), FLOOR * float(np.ptp(self.positions)))

    @property
    def resolution(self) -> float:
        """What all positions are a multiple apart of, m; 0 if there is no such step."""
        steps = np.diff(np.unique(self.positions))
        if not steps.size:
            return 0.0
        # What a decimal number is off by must not pass for a step.
        smallest = float(np.min(steps, where=steps > FLOOR * steps.max(), initial=np.inf))
        counts = steps / smallest
        is_whole = np.abs(counts - np.round(counts)) < WHOLE
        return smallest if smallest > FLOOR * np.ptp(self.positions) and is_whole.all() else 0.0

    def delayed(self, delay_steps: int, skipped: int | None = None) -> "Log":
        """Return the log as one whose controls act at once, where they act so many steps later.

        Args:
            delay_steps: of the actuator.
            skipped: samples that are left out at the beginning, `delay_steps` by default; the same
                for all delays, so that their likelihoods are of the same measurements.
        """
        first = delay_steps if skipped is None else skipped
        last = self.num_steps - delay_steps
        velocities = self.velocities
        return replace(
            self,
            controls=self.controls[first - delay_steps : last],
            positions=self.positions[first:],
            velocities=None if velocities is None else velocities[first:],
        )

    def record(self, stride: int) -> Record:
        """Return the log as the kernel takes it, with every `stride`-th sample as a measurement."""
        steps = min(max(WINDOW_STARTS, stride), self.num_steps)
        elapsed = steps * self.time_step
        noise = 2.0 * self.position_noise / elapsed
        velocity = (self.positions[steps] - self.positions[0]) / elapsed
        fastest = np.max(np.abs(np.diff(self.positions[: 4 * steps + 1 : steps]))) / elapsed
        return Record(
            np.ascontiguousarray(self.controls, dtype=np.float64),
            np.ascontiguousarray(self.positions, dtype=np.float64),
            np.zeros(0)
            if self.velocities is None
            else np.ascontiguousarray(self.velocities, dtype=np.float64),
            self.position_lag,
            stride,
            float(velocity),
            float(noise + 0.3 * fastest),
        )


def _noise_of(values: FloatArray) -> float:
    """Return a robust estimate of the noise in values (N,): its standard deviation.

    From the third differences, in which smooth motion is all but gone. The noise's are the root of
    20 times as large as itself, and half of them less than 0.6745 of their standard deviation.
    """
    return float(np.median(np.abs(np.diff(values, 3))) / NORMAL_MEDIAN / np.sqrt(20.0))
