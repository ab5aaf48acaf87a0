"""Forecasts beside simulations of what they forecast."""

from dataclasses import dataclass
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.inference.job import Job
from app.inference.sampling import Sampling
from app.inference.shares import half_least_half_urgent
from app.serving.forecast import finish_times, queue_times, turn_times

BUDGET = 64


@dataclass(eq=False)
class Waiting:
    """A sampling all of whose rows wait at once."""

    job: Job

    @property
    def rows_waiting(self) -> int:
        return self.job.rows_left

    def ticks_left(self, budget: int) -> float:
        return self.job.rows_left / budget


def simulated(rows: list[int]) -> list[float]:
    """Share out ticks as the engine does; return when each is done, in rows."""
    samplings = [Waiting(Job(count, deadline=1e10 + i)) for i, count in enumerate(rows)]
    finished = [0.0] * len(rows)
    now = 0
    while waiting := [sampling for sampling in samplings if sampling.job.rows_left]:
        shares = half_least_half_urgent(cast(list[Sampling], waiting), BUDGET, tick_seconds=0.0)
        now += sum(shares.values())
        for sampling, count in cast(dict[Waiting, int], shares).items():
            sampling.job.rows_left -= count
            if not sampling.job.rows_left:
                finished[samplings.index(sampling)] = now
    return finished


# Not nearly equal: which of two such is the least to do turns on a row more or less.
@given(st.lists(st.sampled_from([3, 60, 500, 4000, 20_000]), max_size=12))
def test_the_forecast_is_what_the_engines_rule_comes_to(rows: list[int]) -> None:
    # Ticks are whole, and what one half leaves goes to the next in line: each may cost a tick.
    assert finish_times(rows) == pytest.approx(simulated(rows), abs=BUDGET * (len(rows) + 1))


def test_a_small_one_beside_large_ones_takes_twice_its_time() -> None:
    assert finish_times([1000.0, 1000.0, 1.0]) == [1001.0, 2001.0, 2.0]


def test_equal_ones_are_done_in_the_order_in_which_they_came() -> None:
    assert finish_times([2.0, 2.0, 2.0]) == [2.0, 4.0, 6.0]


def test_nothing_to_do_is_done() -> None:
    assert finish_times([]) == []
    assert finish_times([0.0, 1.0]) == [0.0, 1.0]
    assert queue_times([], 2) == []


def test_a_queue_is_served_in_order_by_whoever_is_free() -> None:
    assert queue_times([3.0, 1.0, 1.0, 5.0], servers=2) == [3.0, 1.0, 2.0, 7.0]
    assert queue_times([3.0, 1.0], servers=1) == [3.0, 4.0]


@given(st.lists(st.floats(0.001, 100), min_size=1, max_size=20))
def test_the_last_is_done_when_all_the_work_is(work: list[float]) -> None:
    assert max(finish_times(work)) == pytest.approx(sum(work))
    assert queue_times(work, 1)[-1] == pytest.approx(sum(work))


def turns_taken(work: list[int], first: list[int], servers: int) -> list[int]:
    """Let everybody take turns of one unit behind `first`; return when each is done."""
    left, waiting = list(work), sorted(first, reverse=True)
    finished, now, turn = [0] * len(work), 0, 0
    busy: list[int] = []
    while any(left) or waiting or busy:
        while len(busy) < servers and waiting:
            busy.append(waiting.pop(0))
        free = servers - len(busy)
        for _ in range(free):
            if not any(left):
                break
            while not left[turn % len(left)]:
                turn += 1
            left[turn % len(left)] -= 1
            turn += 1
        now += 1
        busy = [seconds - 1 for seconds in busy if seconds > 1]
        for i, units in enumerate(left):
            if not units and not finished[i]:
                finished[i] = now
    return finished


@given(
    st.lists(st.integers(1, 20), min_size=1, max_size=5),
    st.lists(st.integers(1, 20), max_size=4),
    st.integers(1, 3),
)
def test_who_takes_turns_is_done_no_later_than_forecast(
    work: list[int], first: list[int], servers: int
) -> None:
    forecast = turn_times(work, first, servers)
    actual = turns_taken(work, first, servers)
    # A turn is not infinitely short: there is one of each before one's own.
    assert all(a <= f + len(work) + 1 for a, f in zip(actual, forecast, strict=True))
    alone = turn_times([10], [], 1)
    assert alone == [10]
