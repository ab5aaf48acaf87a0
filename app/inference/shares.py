"""Whose rows go through the network next."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

from app.inference.sampling import Sampling

Share: TypeAlias = Callable[[Sequence[Sampling], int], dict[Sampling, int]]
"""(samplings with rows that wait, rows of the tick) -> how many rows each of them gets."""


def half_least_half_urgent(samplings: Sequence[Sampling], budget: int) -> dict[Sampling, int]:
    """Give half of a tick to whoever has the least left to do, half to the nearest deadline.

    What one half does not need the other gets. So a small request never waits behind large ones,
    however many, and a large one goes on at half the speed at least once its deadline is the
    nearest, however many small ones keep coming. Where nobody names a deadline, all have the same
    time, and the nearest deadline is that of the oldest.

    Args:
        samplings: each with rows that wait.
        budget: rows of the tick.
    """
    by_urgency = sorted(samplings, key=lambda sampling: sampling.job.urgency)
    by_work = sorted(by_urgency, key=lambda sampling: sampling.job.rows_left)
    shares = dict.fromkeys(by_urgency, 0)
    left = budget
    for order, kept in ((by_work, budget - budget // 2), (by_urgency, 0)):
        for sampling in order:
            taken = min(sampling.rows_waiting - shares[sampling], left - kept)
            shares[sampling] += taken
            left -= taken
    return {sampling: rows for sampling, rows in shares.items() if rows}
