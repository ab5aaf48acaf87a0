"""The structured control prior of the training data (paper, Sect. 4.2)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Interval, Le

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.options import Options
from app.planning.plant.system import Plant

Fraction = Annotated[float, Interval(ge=0, le=1)]


@dataclass(frozen=True, slots=True)
class ControlPrior(Options):
    """Piecewise constant kicks, medium and near-zero inputs, smoothed by a first-order filter.

    Magnitudes are fractions of the control limit u_max, forward and backward of each side's.
    """

    num_segments: Annotated[int, Ge(1), Le(1024)] = 8
    kick_probability: Fraction = 0.4
    medium_probability: Fraction = 0.4
    """What the two leave of 1 is the probability of a near-zero segment."""
    kick_minimum: Fraction = 0.75
    medium_maximum: Fraction = 0.6
    near_zero_maximum: Fraction = 0.15
    filter_coefficient: Fraction = 0.3
    """alpha in y[k] = alpha*y[k-1] + (1-alpha)*s[k], y[-1] = s[0]."""

    def check_combination(self) -> None:
        """Check what the ranges do not say.

        Raises:
            ValueError: the two probabilities exceed 1 together.
        """
        if self.kick_probability + self.medium_probability > 1 + 1e-12:
            raise ValueError("kick_probability + medium_probability must not exceed 1")

    def sample(
        self,
        num_candidates: int,
        horizon: int,
        plant: Plant,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Draw `num_candidates` control sequences; return (K, H) within the plant's limits."""
        # Drawn here: a kernel that takes a generator is called much more slowly.
        draws = rng.random((num_candidates, self.num_segments, 2))
        return _sample(
            draws,
            horizon,
            plant,
            float(self.kick_probability),
            float(self.medium_probability),
            float(self.kick_minimum),
            float(self.medium_maximum),
            float(self.near_zero_maximum),
            float(self.filter_coefficient),
        )


@compiled
def _sample(
    draws: FloatArray,
    horizon: int,
    plant: Plant,
    kick_probability: float,
    medium_probability: float,
    kick_minimum: float,
    medium_maximum: float,
    near_zero_maximum: float,
    filter_coefficient: float,
) -> FloatArray:
    """Return controls (K, H) from uniform `draws` (K, segments, 2), within [0, 1): which mode a
    segment has, and its value.
    """
    num_candidates, num_segments, _ = draws.shape
    controls = np.empty((num_candidates, horizon))
    segments = np.empty(num_segments)
    for candidate in range(num_candidates):
        for segment in range(num_segments):
            mode = draws[candidate, segment, 0]
            value = 2.0 * draws[candidate, segment, 1] - 1.0
            if mode < kick_probability:
                magnitude = kick_minimum + (1.0 - kick_minimum) * abs(value)
                segments[segment] = magnitude if value >= 0.0 else -magnitude
            elif mode < kick_probability + medium_probability:
                segments[segment] = medium_maximum * value
            else:
                segments[segment] = near_zero_maximum * value
        filtered = segments[0]
        for k in range(horizon):
            segment_value = segments[k * num_segments // horizon]
            filtered = filter_coefficient * filtered + (1.0 - filter_coefficient) * segment_value
            limit = plant.highest_control if filtered >= 0.0 else -plant.lowest_control
            # A convex combination of values within [-1, 1]; the clip only guards the last bit.
            control = limit * min(1.0, max(-1.0, filtered))
            controls[candidate, k] = min(plant.highest_control, max(plant.lowest_control, control))
    return controls
