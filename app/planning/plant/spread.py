"""By how much a plant may be off: what a learned model is told of an ensemble."""

from typing import NamedTuple

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.system import Plant

COLUMNS = {
    "static_friction": ("static_forward", "static_backward"),
    "coulomb_friction": ("coulomb_forward", "coulomb_backward"),
    "viscous_damping": ("damping_forward", "damping_backward"),
    "control_gain": ("control_gain",),
}
"""What of a `Plant` each parameter is."""
LEAST = 1e-12
"""No parameter is counted as less, where something is divided by it."""
FAR = 1e6
"""Shares beyond it are not told apart."""


class Spread(NamedTuple):
    """By what share of its value each parameter may be off, either way; floats or (N,).

    Of parameters that are uniform and independent; of others what has the same mean square.
    """

    static_friction: float = 0.0
    coulomb_friction: float = 0.0
    viscous_damping: float = 0.0
    control_gain: float = 0.0

    def within(self, most: "Spread") -> "Spread":
        """Return the nearest spread that exceeds `most` nowhere."""
        return Spread(*map(min, self, most))


CERTAIN = Spread()
"""The plant is known exactly."""


class Told(NamedTuple):
    """What a model was told of the plants that may be the true one."""

    spread: Spread
    left_out: tuple[str, ...]
    """What it could not be told of them, in words: none where the spread says it all."""


def spread_of(plants: FloatArray, plant: Plant) -> Spread:
    """Return the spread of `plants` (S, parameters) around `plant`.

    A uniform distribution's half width is its root mean square times the root of 3.
    """
    columns = dict(zip(Plant._fields, plants.T, strict=True))

    def share(names: tuple[str, ...]) -> float:
        values = np.array([getattr(plant, name) for name in names])
        found = np.array([columns[name] for name in names])
        off = (found - values[:, np.newaxis]) / np.maximum(values, LEAST)[:, np.newaxis]
        return min(FAR, float(np.sqrt(3.0 * np.mean(off**2))))

    return Spread(*(share(names) for names in COLUMNS.values()))
