"""What a controller is told of its sensor, and how much of its model it may correct: options.

The filter itself is in kalman.py.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

from annotated_types import Ge, Le

from app.planning.control.memory import (
    BACKWARD,
    BIAS,
    COULOMB,
    DAMPING,
    FORWARD,
    GAIN,
    LEAST,
    MOST,
    Memory,
)
from app.planning.control.switching import least_hop
from app.planning.options import Options
from app.planning.plant.system import Plant

Share: TypeAlias = Annotated[float, Ge(0), Le(0.9)]
Noise: TypeAlias = Annotated[float, Ge(0), Le(1000)]
LEAST_POSITION_NOISE, LEAST_VELOCITY_NOISE = 1e-6, 1e-5
"""m and m/s: no sensor is believed to be better."""
REST_SHARE = 0.8
"""Of the velocity that a step of full control gives a mass at rest: slower than this may count as
at rest where the sensor does not tell."""
DEAD_BANDS_NOISE = 3.0
LEAST_DEAD_BAND = 3e-4
"""m."""


@dataclass(frozen=True, slots=True)
class Identification(Options):
    """By what share of its value each parameter of the model may be off: it is learned on the way.

    Uniform, independent; forces that push the mass (a force pulse) freeze learning for a moment.
    """

    static_friction: Share = 0.2
    coulomb_friction: Share = 0.2
    viscous_damping: Share = 0.2
    control_gain: Share = 0.05
    asymmetry: Share = 0.2
    """Of the Coulomb friction: by so much an unknown bias, or a friction that differs by direction
    though the model's does not, may pull."""

    def begin(self, memory: Memory, model: Plant) -> None:
        """Set what is believed of the model's parameters before the first step."""
        shares = (
            (GAIN, self.control_gain),
            (COULOMB, self.coulomb_friction),
            (DAMPING, self.viscous_damping),
            (BIAS, self.asymmetry * max(model.coulomb_forward, model.coulomb_backward)),
        )
        for parameter, half_width in shares:
            # The variance of a uniform distribution is a third of its half width's square.
            memory.covariance[parameter, parameter] = half_width**2 / 3.0
        memory.statics[:, LEAST] *= 1.0 - self.static_friction
        memory.statics[:, MOST] *= 1.0 + self.static_friction


@dataclass(frozen=True, slots=True)
class Observer(Options):
    """A Kalman filter through the stick-slip step, of positions alone or with velocities.

    All noise is given as standard deviations.
    """

    position_noise: Noise = 1e-4
    """m."""
    velocity_noise: Noise = 1e-2
    """m/s, where velocities are measured."""
    position_step: Noise = 0.0
    """m: the resolution of an encoder, 0 for none; it adds its own noise."""
    acceleration_noise: Noise = 0.02
    """m/s^2, of a time step: forces that the model does not know."""
    identification: Identification | None = field(default_factory=Identification)
    """What is learned of the model on the way; none: nothing."""

    @property
    def position_std(self) -> float:
        """Of a measured position with what the encoder's resolution adds, m."""
        quantised = self.position_step / math.sqrt(12.0)
        return max(LEAST_POSITION_NOISE, math.hypot(self.position_noise, quantised))

    @property
    def velocity_std(self) -> float:
        """Of a measured velocity, m/s."""
        return max(LEAST_VELOCITY_NOISE, self.velocity_noise)

    def rest_velocity(self, model: Plant) -> float:
        """Return below which velocity an estimate counts as at rest, m/s."""
        least = REST_SHARE * least_hop(model) / model.time_step
        noise = min(self.velocity_std, self.position_std / model.time_step)
        return max(model.velocity_threshold, min(noise, least))

    @property
    def dead_band(self) -> float:
        """How near to the target the sensor lets a controller come, m."""
        return max(LEAST_DEAD_BAND, DEAD_BANDS_NOISE * self.position_std)


def begin(observer: Observer | None, model: Plant) -> Memory:
    """Return the memory of a controller before its first step."""
    memory = Memory.empty()
    memory.mean[[GAIN, COULOMB, DAMPING]] = 1.0
    memory.mean[BIAS] = model.bias
    memory.statics[FORWARD] = model.static_forward
    memory.statics[BACKWARD] = model.static_backward
    if observer and observer.identification:
        observer.identification.begin(memory, model)
    return memory
