"""Whose rows go through the network next."""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import TypeAlias

from app.inference.sampling import Sampling

SAFETY_FACTOR = 1.5
"""A deadline is in danger if less time is left than this many times what the sampling needs."""

Share: TypeAlias = Callable[[Sequence[Sampling], int, float], dict[Sampling, int]]
"""(samplings with rows that wait, rows of a tick, its seconds) -> the rows that each of them gets.
"""


def half_least_half_urgent(
    samplings: Sequence[Sampling], budget: int, tick_seconds: float
) -> dict[Sampling, int]:
    """Give half of a tick to whoever has the least left to do, half to the nearest deadline.

    What one half does not need the other gets. So a small request never waits behind large ones,
    however many, and a large one goes on at half the speed at least once its deadline is the
    nearest, however many small ones keep coming. Where nobody names a deadline, all have the same
    time, and the nearest deadline is that of the oldest. Before all of that come those whose
    deadline is in danger.

    Args:
        samplings: each with rows that wait.
        budget: rows of the tick.
        tick_seconds: how long a tick takes about.
    """
    now = perf_counter()
    by_urgency = sorted(samplings, key=lambda sampling: sampling.job.urgency)
    by_work = sorted(by_urgency, key=lambda sampling: sampling.job.rows_left)
    in_danger = [
        sampling
        for sampling in by_urgency
        if sampling.job.deadline - now < SAFETY_FACTOR * tick_seconds * sampling.ticks_left(budget)
    ]
    shares = dict.fromkeys(by_urgency, 0)
    left = budget
    for order, share in ((in_danger, 1.0), (by_work, 0.5), (by_urgency, 1.0)):
        kept = left - int(share * left)
        for sampling in order:
            taken = min(sampling.rows_waiting - shares[sampling], left - kept)
            shares[sampling] += taken
            left -= taken
    return {sampling: rows for sampling, rows in shares.items() if rows}
