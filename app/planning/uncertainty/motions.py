"""Motions to start robust plans from: a few plain stretches, in any order.

Among many of them are those that overshoot and come back, which feel an error of the friction
less; the descents of ordinary candidates do not find them.
"""

import math

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import holding_control
from app.planning.plant.system import Plant

FEWEST, MOST = 3, 7
"""Stretches of a motion."""
FULL, MEDIUM, GENTLE, HOLDING = range(4)
KINDS = (FULL, FULL, MEDIUM, GENTLE, HOLDING)
"""Of stretches, each as likely as another."""
SHARES = (1.0, 0.65, 0.45)
"""Of the limits, that a push of each kind takes: slow motions and gentle brakes, too."""

FORWARD = 0.5
"""Share of the pushes that are forward."""


@compiled
def draw_motions(
    rng: np.random.Generator, num_motions: int, horizon: int, plant: Plant
) -> FloatArray:
    """Draw motions (N, H) of 3 to 7 stretches, whose ends are uniform over the horizon.

    Two in five stretches push with a full limit, two with a part of one, one holds the mass.
    """
    controls = np.empty((num_motions, horizon))
    holding = holding_control(plant)
    ends = np.empty(MOST)
    for i in range(num_motions):
        stretches = FEWEST + int((MOST + 1 - FEWEST) * rng.random())
        total = 0.0
        for j in range(stretches):
            # Sums of exponential variates, by their total, are uniform numbers in their order.
            total -= math.log(1.0 - rng.random())
            ends[j] = total
        k = 0
        for j in range(stretches):
            kind = KINDS[int(len(KINDS) * rng.random())]
            limit = plant.highest_control if rng.random() < FORWARD else plant.lowest_control
            level = holding if kind == HOLDING else SHARES[kind] * limit
            level = min(plant.highest_control, max(plant.lowest_control, level))
            end = horizon if j == stretches - 1 else int(horizon * ends[j] / total)
            while k < end:
                controls[i, k] = level
                k += 1
    return controls
