"""Statistics of paired evaluations."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap


def paired_difference(
    first: NDArray[np.float64], second: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Return the mean of first - second over the tasks, and its 95 % bootstrap interval.

    Args:
        first: (tasks,), one method's measure.
        second: (tasks,), another's on the same tasks.
    """
    differences = first - second
    mean = float(differences.mean())
    if np.ptp(differences) == 0:
        return mean, mean, mean
    interval = bootstrap(
        (differences,), np.mean, n_resamples=2000, rng=np.random.default_rng(0)
    ).confidence_interval
    return mean, float(interval.low), float(interval.high)
