"""What a learned model is told of an ensemble: the nearest spread that it knows."""

from collections.abc import Iterator

import numpy as np

from app.planning.plant.spread import COLUMNS, Spread, Told, spread_of
from app.planning.plant.system import Plant
from app.planning.uncertainty.uncertainty import Uncertainty

SAME = 1e-9
"""Shares that differ by no more are equal."""
LOPSIDED = 0.5
"""Of its spread: by more than that the mean of a parameter is not the plant's own."""


def tell(uncertainty: Uncertainty, plant: Plant, most: Spread) -> Told:
    """Return what a model is told of the plants that may be `plant`.

    Args:
        uncertainty: the plants, given or drawn.
        plant: that the model is asked for.
        most: how far each parameter may be off, as far as the model knows.
    """
    relative = uncertainty.relative
    if relative:
        spread = Spread(*(getattr(relative, name) for name in Spread._fields))
    else:
        spread = spread_of(uncertainty.ensemble.plants, plant)
    nearest = spread.within(most)
    return Told(nearest, tuple(_left_out(uncertainty, plant, spread, nearest)))


def _left_out(
    uncertainty: Uncertainty, plant: Plant, spread: Spread, nearest: Spread
) -> Iterator[str]:
    """Yield what of the plants the nearest spread does not say."""
    for name, share, told in zip(Spread._fields, spread, nearest, strict=True):
        if share > told + SAME:
            yield f"{name} may be off by {share:.0%}, the model knows up to {told:.0%}"
    plants = uncertainty.ensemble.plants
    values = dict(zip(Plant._fields, plants.T, strict=True))
    for name in ("bias", "stribeck_velocity"):
        if np.ptp(np.append(values[name], getattr(plant, name))) > SAME:
            yield f"{name} differs, of which the model knows nothing"
    if uncertainty.relative:
        return
    for name, share in zip(Spread._fields, spread, strict=True):
        for column in COLUMNS[name]:
            own = getattr(plant, column)
            if abs(values[column].mean() - own) > LOPSIDED * share * own + SAME:
                yield f"{name} differs in the mean, which the model takes to be the plant's own"
                break
