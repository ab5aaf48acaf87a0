"""Timing two things against each other."""

from collections.abc import Callable
from statistics import median
from time import perf_counter, sleep

UNMEASURED, MEASURED = 3, 15
SETTLING_S = 0.02
"""By then the threads of PyTorch's last operation no longer spin on their cores."""


def paired(
    first: Callable[[], object], second: Callable[[], object], pairs: int, settle: bool = False
) -> tuple[float, float]:
    """Call the two in turn, once unmeasured; return the median milliseconds of each.

    Args:
        first: one call.
        second: the other.
        pairs: how often.
        settle: before each measured second call, wait for the first one's threads to end and make
            a call that does not count, after which code and data are in the caches again.
    """
    times: tuple[list[float], list[float]] = ([], [])
    for pair in range(pairs + 1):
        for call, durations in zip((first, second), times, strict=True):
            if settle and call is second:
                sleep(SETTLING_S)
                second()
            started = perf_counter()
            call()
            if pair:
                durations.append((perf_counter() - started) * 1e3)
    return median(times[0]), median(times[1])


def median_ms(call: Callable[[], object]) -> float:
    """Return the median time of a call, after some that do not count."""
    sleep(SETTLING_S)
    times = []
    for _ in range(UNMEASURED + MEASURED):
        started = perf_counter()
        call()
        times.append((perf_counter() - started) * 1e3)
    return median(times[UNMEASURED:])
