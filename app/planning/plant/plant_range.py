"""Plants by ranges of their parameters: which ones a model was trained for."""

from dataclasses import asdict, dataclass
from typing import Self, TypeAlias

from app.planning.options import Options
from app.planning.plant.system import System

Bounds: TypeAlias = tuple[float, float]
"""Least and greatest value, both included."""


@dataclass(frozen=True, slots=True)
class PlantRange(Options):
    """All plants whose every parameter lies within its bounds; fields and units of `System`."""

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
        """Return the range that holds one plant."""
        return cls(**{name: (value, value) for name, value in asdict(system).items()})

    def covers(self, system: System) -> bool:
        """Say whether a plant lies within the range."""
        bounds = asdict(self)
        return all(
            bounds[name][0] <= value <= bounds[name][1] for name, value in asdict(system).items()
        )

    def nearest(self, system: System) -> System:
        """Return the plant of the range whose parameters are nearest to those of `system`."""
        bounds = asdict(self)
        return System(
            **{
                name: min(max(value, bounds[name][0]), bounds[name][1])
                for name, value in asdict(system).items()
            }
        )

    def __str__(self) -> str:
        """Write each parameter as a number, or as a range."""
        return ", ".join(f"{name} {in_words(bounds)}" for name, bounds in asdict(self).items())


def in_words(bounds: Bounds) -> str:
    """Write bounds as a range, or as a number where they are one."""
    low, high = bounds
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
