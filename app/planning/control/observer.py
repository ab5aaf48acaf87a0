"""What a controller is told of its sensor, and how much of its model it may correct: options.

The filter itself is in kalman.py.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

from annotated_types import Ge, Le

from app.planning.control.settings import Settings
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
    """Of static friction, in either direction."""
    coulomb_friction: Share = 0.2
    """Of Coulomb friction."""
    viscous_damping: Share = 0.2
    """Of the damping."""
    control_gain: Share = 0.05
    """Of the gain."""
    asymmetry: Share = 0.2
    """Of the Coulomb friction: by so much an unknown bias, or a friction that differs by direction
    though the model's does not, may pull."""

    def within(self, settings: Settings, model: Plant) -> Settings:
        """Return `settings` with what may be wrong with a `model`."""
        friction = max(model.coulomb_forward, model.coulomb_backward)
        return settings._replace(
            gain_variance=_variance(self.control_gain),
            coulomb_variance=_variance(self.coulomb_friction),
            damping_variance=_variance(self.viscous_damping),
            bias_variance=_variance(self.asymmetry * friction),
            static_share=self.static_friction,
        )


def _variance(half_width: float) -> float:
    """Return the variance of a uniform distribution: a third of its half width's square."""
    return half_width**2 / 3.0


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
    position_lag: Noise = 0.0
    """s: measured positions are those of so long ago, at the velocity of now. Half a time step
    where a control is held from sample to sample, as on machines; `POST /identify` tells it."""

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
