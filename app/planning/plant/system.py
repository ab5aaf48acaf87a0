"""The plant's parameters, as a user gives them and as the kernels take them."""

from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from typing import Annotated, NamedTuple, TypeAlias

from annotated_types import Ge, Le

from app.planning.options import Options

LARGEST, SMALLEST = 1e6, 1e-6
"""Of parameters and states: no plant comes near, and nothing computed from them overflows."""

NotNegative: TypeAlias = Annotated[float, Ge(0), Le(LARGEST)]
Positive: TypeAlias = Annotated[float, Ge(SMALLEST), Le(LARGEST)]
Number: TypeAlias = Annotated[float, Ge(-LARGEST), Le(LARGEST)]


class Plant(NamedTuple):
    """A `System` as the kernels take it: floats by name, in the same units.

    Flat, since every call of a kernel from Python pays for each tuple within a tuple.
    """

    static_forward: float
    static_backward: float
    coulomb_forward: float
    coulomb_backward: float
    damping_forward: float
    damping_backward: float
    breakaway_forward: float
    """What opposes the first step from rest: Coulomb friction, or with Stribeck's effect static."""
    breakaway_backward: float
    stribeck_velocity: float
    """0: dry friction is Coulomb friction from the first motion on."""
    bias: float
    control_gain: float
    lowest_control: float
    highest_control: float
    time_step: float
    velocity_threshold: float


@dataclass(frozen=True, slots=True)
class ByDirection(Options):
    """A friction that differs by the direction of motion."""

    forward: NotNegative
    """Of motion with v > 0, in the unit of the friction."""
    backward: NotNegative
    """Of motion with v < 0, as a positive number in the same unit."""


@dataclass(frozen=True, slots=True)
class ControlLimits(Options):
    """The range of a control, both ends included."""

    lower: Number
    """Units of control."""
    upper: Number
    """Units of control; greater than `lower`."""

    def check_combination(self) -> None:
        """Check the order.

        Raises:
            ValueError: the upper limit does not exceed the lower one.
        """
        if not self.upper - self.lower >= SMALLEST:
            raise ValueError(f"upper must exceed lower by at least {SMALLEST:g}")


@dataclass(frozen=True, slots=True)
class System(Options):
    """Parameters of the plant, per unit mass (paper, Table 2 and Eq. 6).

    With a = control_gain * u + bias, the mass breaks away where a exceeds the static friction of a
    direction, and slides with v' = a - friction * sign(v) - viscous_damping * v.
    """

    static_friction: NotNegative | ByDirection = 0.7
    """f_s, m/s^2: a mass at rest moves only if |a| exceeds it."""
    coulomb_friction: NotNegative | ByDirection = 0.6
    """f_c, m/s^2: opposes the motion."""
    viscous_damping: NotNegative | ByDirection = 0.05
    """b, 1/s."""
    _: KW_ONLY
    stribeck_velocity: Positive | None = None
    """v_s, m/s: friction falls from static to Coulomb as exp(-(v/v_s)^2); at once without it."""
    bias: Number = 0.0
    """m/s^2: a constant acceleration, of a slope, gravity, a cable or the drive's offset."""
    control_gain: Positive = 1.0
    """m/s^2 for each unit of control (N, V, A, whatever the machine takes)."""
    control_limit: Positive | ControlLimits = 0.9
    """u_max, units of control: controls lie in [-u_max, u_max], or between two limits."""
    time_step: Positive = 0.05
    """dt, s."""
    velocity_threshold: Positive = 1e-3
    """eps_v, m/s: slower than this counts as at rest."""

    def check_combination(self) -> None:
        """Check what the parameters have to be together.

        Raises:
            ValueError: Coulomb friction exceeds static friction, or the damping is too strong for
                the time step.
        """
        plant = self.plant
        for direction, coulomb, static, damping in (
            ("forward", plant.coulomb_forward, plant.static_forward, plant.damping_forward),
            ("backward", plant.coulomb_backward, plant.static_backward, plant.damping_backward),
        ):
            whose = "" if self.is_same_both_ways else f" {direction}"
            if coulomb > static:
                raise ValueError(f"coulomb_friction must not exceed static_friction{whose}")
            if damping * plant.time_step >= 1:
                raise ValueError(f"viscous_damping * time_step must be below 1{whose}")

    @property
    def is_same_both_ways(self) -> bool:
        """Whether friction has no direction, as far as the fields say it."""
        frictions = (self.static_friction, self.coulomb_friction, self.viscous_damping)
        return not any(isinstance(friction, ByDirection) for friction in frictions)

    @property
    def plant(self) -> Plant:
        """The parameters as the kernels take them."""
        return _plant_of(self)


@lru_cache(maxsize=1024)
def _plant_of(system: System) -> Plant:
    """Return what the kernels take, which is asked for several times a plan."""
    static_forward, static_backward = _both_ways(system.static_friction)
    coulomb_forward, coulomb_backward = _both_ways(system.coulomb_friction)
    weakens = system.stribeck_velocity is not None
    damping_forward, damping_backward = _both_ways(system.viscous_damping)
    if isinstance(system.control_limit, ControlLimits):
        lowest, highest = system.control_limit.lower, system.control_limit.upper
    else:
        lowest, highest = -system.control_limit, system.control_limit
    return Plant(
        static_forward=static_forward,
        static_backward=static_backward,
        coulomb_forward=coulomb_forward,
        coulomb_backward=coulomb_backward,
        damping_forward=damping_forward,
        damping_backward=damping_backward,
        breakaway_forward=static_forward if weakens else coulomb_forward,
        breakaway_backward=static_backward if weakens else coulomb_backward,
        stribeck_velocity=float(system.stribeck_velocity or 0.0),
        bias=float(system.bias),
        control_gain=float(system.control_gain),
        lowest_control=float(lowest),
        highest_control=float(highest),
        time_step=float(system.time_step),
        velocity_threshold=float(system.velocity_threshold),
    )


def _both_ways(friction: float | ByDirection) -> tuple[float, float]:
    """Return a friction forward and backward."""
    if isinstance(friction, ByDirection):
        return float(friction.forward), float(friction.backward)
    return float(friction), float(friction)
