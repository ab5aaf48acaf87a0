"""Machines that are not known exactly: random levels of uncertainty, and plants within them."""

from typing import Annotated

import numpy as np
from pydantic import Field

from app.planning.arrays import FloatArray
from app.planning.plant.spread import COLUMNS, Spread
from app.planning.plant.system import Plant
from training.section import Section, Share
from training.tasks import Tasks

NUM_PLANTS = 8
"""Of the small ensemble on which a predicted plan is judged."""
MOST_DAMPING = 0.99
"""Of the velocity, in a step: every plant loses less than all of it."""
MostShare = Annotated[float, Field(ge=0, le=0.9)]


class RandomSpreads(Section):
    """How far the parameters of a machine may be off: uniform shares, up to a greatest one."""

    friction: MostShare = 0.2
    """Static and Coulomb friction, and damping."""
    gain: MostShare = 0.1
    alike: Share = 0.7
    """Of the machines whose frictions may be off by the same share; the others' differ."""

    @property
    def most(self) -> Spread:
        """The greatest shares."""
        return Spread(self.friction, self.friction, self.friction, self.gain)

    def sample(self, size: int, rng: np.random.Generator) -> FloatArray:
        """Draw spreads (N, 4)."""
        spreads = rng.random((size, len(Spread._fields))) * self.most
        same = rng.random(size) < self.alike
        spreads[same, 1:3] = spreads[same, :1]
        return spreads


def plants_within(tasks: Tasks, rng: np.random.Generator) -> FloatArray:
    """Draw plants within the spreads: (N, S, parameters), S = 1 where all are known exactly.

    Each has an opposite, with every parameter off the other way.
    """
    if not tasks.spreads.any():
        return tasks.plants[:, np.newaxis]
    half = rng.uniform(-1.0, 1.0, (len(tasks), NUM_PLANTS // 2, len(Spread._fields)))
    factors = 1.0 + np.concatenate([half, -half], axis=1) * tasks.spreads[:, np.newaxis]
    plants = np.repeat(tasks.plants[:, np.newaxis], NUM_PLANTS, axis=1)
    columns = dict(zip(Plant._fields, np.moveaxis(plants, 2, 0), strict=True))
    for names, factor in zip(COLUMNS.values(), np.moveaxis(factors, 2, 0), strict=True):
        for name in names:
            columns[name] *= factor
    weakens = columns["stribeck_velocity"] > 0.0
    for direction in ("forward", "backward"):
        static, coulomb = columns[f"static_{direction}"], columns[f"coulomb_{direction}"]
        damping = columns[f"damping_{direction}"]
        np.maximum(static, coulomb, out=static)
        np.minimum(damping, MOST_DAMPING / columns["time_step"], out=damping)
        columns[f"breakaway_{direction}"][:] = np.where(weakens, static, coulomb)
    return plants
