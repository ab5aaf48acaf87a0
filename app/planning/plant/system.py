"""The plant: a unit mass with Coulomb friction, viscous damping and stiction, and its rollouts."""

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from app.compilation import compiled
from app.planning.options import OPTION_CHECKS, check_ranges

FloatArray: TypeAlias = NDArray[np.float64]
Parameters: TypeAlias = tuple[float, float, float, float, float, float]

LARGEST, SMALLEST = 1e6, 1e-6
"""Of parameters and states: no plant comes near, and nothing computed from them overflows."""


@dataclass(frozen=True, slots=True)
class System:
    """Parameters of the plant, per unit mass (paper, Table 2 and Eq. 6)."""

    __pydantic_config__ = OPTION_CHECKS

    static_friction: Annotated[float, Ge(0), Le(LARGEST)] = 0.7
    """f_s, m/s^2: a mass at rest moves only if |u| exceeds it."""
    coulomb_friction: Annotated[float, Ge(0), Le(LARGEST)] = 0.6
    """f_c, m/s^2: opposes the motion."""
    viscous_damping: Annotated[float, Ge(0), Le(LARGEST)] = 0.05
    """b, 1/s."""
    control_limit: Annotated[float, Ge(SMALLEST), Le(LARGEST)] = 0.9
    """u_max, m/s^2: controls lie in [-u_max, u_max]."""
    time_step: Annotated[float, Ge(SMALLEST), Le(LARGEST)] = 0.05
    """dt, s."""
    velocity_threshold: Annotated[float, Ge(SMALLEST), Le(LARGEST)] = 1e-3
    """eps_v, m/s: slower than this counts as at rest."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: a parameter is not finite or out of range, Coulomb friction exceeds
                static friction, or the damping is too strong for the time step.
        """
        check_ranges(self)
        if self.coulomb_friction > self.static_friction:
            raise ValueError("coulomb_friction must not exceed static_friction")
        if self.viscous_damping * self.time_step >= 1:
            raise ValueError("viscous_damping * time_step must be below 1")

    @property
    def parameters(self) -> Parameters:
        """The parameters as the tuple of floats that the kernels take, in the order above."""
        return (
            float(self.static_friction),
            float(self.coulomb_friction),
            float(self.viscous_damping),
            float(self.control_limit),
            float(self.time_step),
            float(self.velocity_threshold),
        )


@compiled
def step(
    position: float, velocity: float, control: float, parameters: Parameters
) -> tuple[float, float]:
    """Advance one time step; return the new position (m) and velocity (m/s).

    Paper Eq. 6, semi-implicit Euler with the post-friction velocity. A sliding step whose velocity
    would change sign ends at rest instead: friction stops a mass, it does not reverse it.
    """
    static_friction, coulomb_friction, damping, _, time_step, threshold = parameters
    if abs(velocity) < threshold:
        if abs(control) <= static_friction:
            return position, 0.0
        velocity += time_step * (control - math.copysign(coulomb_friction, control))
    else:
        acceleration = control - math.copysign(coulomb_friction, velocity) - damping * velocity
        next_velocity = velocity + time_step * acceleration
        velocity = 0.0 if next_velocity * velocity < 0.0 else next_velocity
    return position + time_step * velocity, velocity


@compiled
def terminal_state(
    controls: FloatArray, position: float, velocity: float, parameters: Parameters
) -> tuple[float, float]:
    """Return the state that `controls` (H,) lead to."""
    for control in controls:
        position, velocity = step(position, velocity, control, parameters)
    return position, velocity


@compiled
def _rollout(
    controls: FloatArray, initial_states: FloatArray, parameters: Parameters
) -> FloatArray:
    num_candidates, horizon = controls.shape
    states = np.empty((num_candidates, horizon + 1, 2))
    for candidate in range(num_candidates):
        p, v = initial_states[candidate, 0], initial_states[candidate, 1]
        states[candidate, 0, 0], states[candidate, 0, 1] = p, v
        for k in range(horizon):
            p, v = step(p, v, controls[candidate, k], parameters)
            states[candidate, k + 1, 0], states[candidate, k + 1, 1] = p, v
    return states


def rollout(system: System, initial_states: FloatArray, controls: FloatArray) -> FloatArray:
    """Roll `controls` (K, H) out from one state (2,) or one each (K, 2).

    Returns:
        States (K, H+1, 2), the initial ones first.
    """
    starts = np.broadcast_to(initial_states, (len(controls), 2))
    return _rollout(
        np.ascontiguousarray(controls, dtype=np.float64),
        np.ascontiguousarray(starts, dtype=np.float64),
        system.parameters,
    )
