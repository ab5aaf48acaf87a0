"""Plants by ranges of their parameters: which ones a model was trained for."""

from dataclasses import asdict, dataclass
from typing import Self, TypeAlias

from app.planning.options import Options
from app.planning.plant.system import System

Bounds: TypeAlias = tuple[float, float]
"""Least and greatest value, both included."""
ONLY = "the same both ways, without bias, gain or Stribeck effect"


@dataclass(frozen=True, slots=True)
class PlantRange(Options):
    """All plants whose every parameter lies within its bounds; fields and units of `System`.

    They are the same both ways, without a bias, a control gain or Stribeck's effect.
    """

    static_friction: Bounds
    coulomb_friction: Bounds
    viscous_damping: Bounds
    control_limit: Bounds
    time_step: Bounds
    velocity_threshold: Bounds

    def check_combination(self) -> None:
        """Check the order.

        Raises:
            ValueError: a lower bound exceeds its upper one.
        """
        for name, (low, high) in asdict(self).items():
            if not low <= high:
                raise ValueError(f"{name} is a range from {low} to {high}")

    @classmethod
    def only(cls, system: System) -> Self:
        """Return the range that holds one plant.

        Raises:
            ValueError: the plant has what no range has.
        """
        parameters = _parameters_of(system)
        if parameters is None:
            raise ValueError(f"a range of plants has {ONLY}")
        return cls(**{name: (value, value) for name, value in parameters.items()})

    def covers(self, system: System) -> bool:
        """Say whether a plant lies within the range."""
        parameters = _parameters_of(system)
        if parameters is None:
            return False
        bounds = asdict(self)
        return all(
            bounds[name][0] <= value <= bounds[name][1] for name, value in parameters.items()
        )

    def nearest(self, system: System) -> System:
        """Return the plant of the range whose parameters are nearest to those of `system`.

        Of one that differs by direction, those forward count.
        """
        bounds = asdict(self)
        return System(
            **{
                name: min(max(value, bounds[name][0]), bounds[name][1])
                for name, value in _forward_parameters_of(system).items()
            }
        )

    def __str__(self) -> str:
        """Write each parameter as a number, or as a range."""
        parameters = (f"{name} {in_words(bounds)}" for name, bounds in asdict(self).items())
        return f"{', '.join(parameters)}, {ONLY}"


def _parameters_of(system: System) -> dict[str, float] | None:
    """Return the parameters that a range has of a plant; None if it has others beside."""
    plant = system.plant
    only = plant._replace(
        static_backward=plant.static_forward,
        coulomb_backward=plant.coulomb_forward,
        damping_backward=plant.damping_forward,
        stribeck_velocity=0.0,
        bias=0.0,
        control_gain=1.0,
        lowest_control=-plant.highest_control,
    )
    return _forward_parameters_of(system) if plant == only else None


def _forward_parameters_of(system: System) -> dict[str, float]:
    plant = system.plant
    return {
        "static_friction": plant.static_forward,
        "coulomb_friction": plant.coulomb_forward,
        "viscous_damping": plant.damping_forward,
        "control_limit": plant.highest_control,
        "time_step": plant.time_step,
        "velocity_threshold": plant.velocity_threshold,
    }


def in_words(bounds: Bounds) -> str:
    """Write bounds as a range, or as a number where they are one."""
    low, high = bounds
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
