"""Risks: one number for the errors of a plan on all plants of an ensemble."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray

RiskName: TypeAlias = Literal["mean", "worst", "cvar"]


@dataclass(frozen=True, slots=True)
class Risk:
    """The mean of the greatest errors: of all, of the worst, or of a share of them (CVaR)."""

    name: RiskName = "mean"
    level: float = 0.0
    """Of a CVaR: the share of the plants that do not count, in [0, 1]; the worst does."""

    def num_counted(self, num_plants: int) -> float:
        """Return how many of the greatest errors count; the last of them may count in part."""
        if self.name == "worst":
            return 1.0
        return max(1.0, (1.0 - self.level) * num_plants)

    def of(self, errors: FloatArray) -> FloatArray:
        """Return the risk of errors (..., S): shape (...)."""
        weights = np.zeros(errors.shape[-1])
        counted = self.num_counted(len(weights))
        whole = math.floor(counted)
        weights[-whole:] = 1.0
        if whole < len(weights):
            weights[-whole - 1] = counted - whole
        # A product of matrices would round otherwise for one plan than for it among others.
        return np.asarray(np.sum(np.sort(errors, axis=-1) * (weights / counted), axis=-1))


MEAN = Risk()


@compiled
def tail_weights(errors: FloatArray, counted: float, weights: FloatArray) -> float:
    """Fill `weights` (S,) with how much each error counts, 0 to 1; return the risk.

    The `counted` greatest of `errors` (S,) count, the last of them perhaps in part.
    """
    if counted >= errors.size:
        weights[:] = 1.0
        return float(errors.mean())
    total, left = 0.0, counted
    weights[:] = 0.0
    while left > 0.0:
        greatest = -1
        for s in range(errors.size):
            if weights[s] == 0.0 and (greatest < 0 or errors[s] > errors[greatest]):
                greatest = s
        weights[greatest] = min(1.0, left)
        total += weights[greatest] * errors[greatest]
        left -= 1.0
    return total / counted
