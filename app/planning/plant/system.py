"""The plant's parameters, as a user gives them and as the kernels take them."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import Ge, Le

from app.planning.options import Options

LARGEST, SMALLEST = 1e6, 1e-6
"""Of parameters and states: no plant comes near, and nothing computed from them overflows."""


class Plant(NamedTuple):
    """A `System` as the kernels take it: floats by name, in the same units."""

    static_friction: float
    coulomb_friction: float
    viscous_damping: float
    lowest_control: float
    highest_control: float
    time_step: float
    velocity_threshold: float


@dataclass(frozen=True, slots=True)
class System(Options):
    """Parameters of the plant, per unit mass (paper, Table 2 and Eq. 6)."""

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

    def check_combination(self) -> None:
        """Check what the parameters have to be together.

        Raises:
            ValueError: Coulomb friction exceeds static friction, or the damping is too strong for
                the time step.
        """
        if self.coulomb_friction > self.static_friction:
            raise ValueError("coulomb_friction must not exceed static_friction")
        if self.viscous_damping * self.time_step >= 1:
            raise ValueError("viscous_damping * time_step must be below 1")

    @property
    def plant(self) -> Plant:
        """The parameters as the kernels take them."""
        return Plant(
            static_friction=float(self.static_friction),
            coulomb_friction=float(self.coulomb_friction),
            viscous_damping=float(self.viscous_damping),
            lowest_control=-float(self.control_limit),
            highest_control=float(self.control_limit),
            time_step=float(self.time_step),
            velocity_threshold=float(self.velocity_threshold),
        )
