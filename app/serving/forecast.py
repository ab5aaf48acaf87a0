"""When work that is shared out will be done: the arithmetic of admission, on numbers alone."""

from collections.abc import Sequence


def finish_times(work: Sequence[float]) -> list[float]:
    """Return when each of these is done if half the speed goes to the least, half to the urgent.

    That is how the engine shares out its rows (`half_least_half_urgent`), with rows that are
    infinitely small; nobody comes meanwhile.

    Args:
        work: seconds that each takes alone, the most urgent first.

    Returns:
        Seconds from now, in the same order.
    """
    left = list(work)
    finished = [0.0] * len(work)
    by_work = sorted(range(len(work)), key=lambda i: left[i])
    done: set[int] = set()
    now, urgent, rank = 0.0, 0, 0
    while len(done) < len(work):
        while urgent in done:
            urgent += 1
        while by_work[rank] in done:
            rank += 1
        # Only what is served has less left than it had when it was sorted: these two.
        least = by_work[rank]
        if left[urgent] <= left[least]:
            least = urgent
        speed = 1.0 if least == urgent else 0.5
        spent = min(left[least], left[urgent])
        now += spent / speed
        for served in {least, urgent}:
            left[served] -= spent
            if left[served] <= 0.0:
                finished[served] = now
                done.add(served)
    return finished


def queue_times(work: Sequence[float], servers: int) -> list[float]:
    """Return when each of these is done if `servers` take them one after the other, oldest first.

    Args:
        work: seconds that each takes, the oldest first.
        servers: how many are worked on at once.

    Returns:
        Seconds from now, in the same order.
    """
    free_at = [0.0] * servers
    finished = []
    for seconds in work:
        first = free_at.index(min(free_at))
        free_at[first] += seconds
        finished.append(free_at[first])
    return finished


def turn_times(work: Sequence[float], first: Sequence[float], servers: int) -> list[float]:
    """Return when each of these is done, at the latest, if they take turns in small parts.

    Whoever has the least left has had as many turns as each of the others when it is done. What
    comes `first` may keep a server to itself for as long as its longest takes.

    Args:
        work: seconds that each takes.
        first: seconds of each that does not wait for these.
        servers: how many parts are worked on at once.

    Returns:
        Seconds from now, in the same order.
    """
    before, longest = sum(first), max(first, default=0.0)
    return [(before + sum(min(other, own) for other in work)) / servers + longest for own in work]
