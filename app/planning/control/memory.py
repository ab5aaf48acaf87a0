"""What a controller keeps from one step to the next, as the kernels take it.

What a client carries of it is in carry.py.
"""

from typing import NamedTuple

import numpy as np

from app.planning.arrays import FloatArray

MAX_PLAN = 1024
"""Steps of the longest plan that is kept."""
POSITION, VELOCITY, GAIN, COULOMB, DAMPING, BIAS = range(6)
"""What is estimated: m, m/s, three factors of the model's parameters, and m/s^2."""
NUM_ESTIMATED = 6
FORWARD, BACKWARD = 0, 1
LEAST, MOST = 0, 1
STEPS, PLAN_LENGTH, PLAN_AGE, PLAN_ERROR, INTEGRAL, ACTING, FROZEN, PUSHED, TARGET, HELD = range(10)
"""Of `registers`: steps taken; of the plan, how long it is, how many of its controls have been sent
and its terminal error (m); the integral of the error (m/s^2); the control that acts until the next
measurement; steps for which nothing is learned yet; for how many a push has lasted; the position
(m) that the plan is to, or that the mass is held at; whether it is held there, 1 or 0."""
NUM_REGISTERS = HELD + 1


class Memory(NamedTuple):
    """The state of a controller; a step changes it in place."""

    plan: FloatArray
    """(MAX_PLAN,), units of control."""
    mean: FloatArray
    """(6,), of what is estimated."""
    covariance: FloatArray
    """(6, 6)."""
    statics: FloatArray
    """(2, 2): what static friction is at least and at most, forward and backward, m/s^2."""
    registers: FloatArray
    """(10,)."""

    @classmethod
    def empty(cls) -> "Memory":
        """Return the memory of a controller that has not begun."""
        return cls(
            np.zeros(MAX_PLAN),
            np.zeros(NUM_ESTIMATED),
            np.zeros((NUM_ESTIMATED, NUM_ESTIMATED)),
            np.zeros((2, 2)),
            np.zeros(NUM_REGISTERS),
        )

    def copy(self) -> "Memory":
        """Return the same, to be changed apart."""
        return Memory(*(part.copy() for part in self))
