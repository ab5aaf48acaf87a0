"""Who gets the rows of a tick: nobody too many, the small ones soon, the urgent ones in time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from time import perf_counter
from typing import cast

from hypothesis import given
from hypothesis import strategies as st

from app.inference.job import Job
from app.inference.sampling import Sampling
from app.inference.shares import half_least_half_urgent

BUDGET = 64


@dataclass(eq=False)
class Waiting:
    """What the shares know of a sampling: one that asks for the same rows step after step."""

    arrived: float
    rows_per_step: int
    steps: int = 1
    deadline: float = inf
    job: Job = field(init=False)

    def __post_init__(self) -> None:
        self.job = Job(self.rows_per_step * self.steps, self.deadline, arrived=self.arrived)
        self.rows_waiting = self.rows_per_step

    def ticks_left(self, budget: int) -> float:
        return self.job.rows_left / min(budget, self.rows_per_step)

    def give(self, rows: int) -> None:
        self.job.rows_left -= rows
        self.rows_waiting -= rows
        if self.rows_waiting == 0 and self.job.rows_left:
            self.rows_waiting = self.rows_per_step


def share(
    waiting: Sequence[Waiting], budget: int = BUDGET, tick_seconds: float = 0.0
) -> dict[Waiting, int]:
    shares = half_least_half_urgent(cast(list[Sampling], waiting), budget, tick_seconds)
    return cast(dict[Waiting, int], shares)


def ticks_until_done(
    watched: Waiting, others: list[Waiting], newcomer: Callable[[int], Waiting]
) -> int:
    """Count ticks, at each of which somebody else comes."""
    waiting = [watched, *others]
    for tick in range(1, 100_000):
        waiting.append(newcomer(tick))
        for sampling, rows in share(waiting).items():
            sampling.give(rows)
        waiting = [sampling for sampling in waiting if sampling.job.rows_left]
        if watched not in waiting:
            return tick
    raise AssertionError("it starves")


crowds = st.lists(
    st.builds(
        Waiting,
        st.integers(0, 5),
        st.integers(1, 60),
        st.integers(1, 4),
        st.sampled_from([inf, 1e10, 2e10]),
    ),
    min_size=1,
    max_size=12,
)
budgets = st.integers(1, 100)


@given(crowds, budgets)
def test_the_whole_tick_goes_to_rows_that_wait(crowd: list[Waiting], budget: int) -> None:
    shares = share(crowd, budget)

    assert sum(shares.values()) == min(budget, sum(sampling.rows_waiting for sampling in crowd))
    for sampling, rows in shares.items():
        assert sampling in crowd
        assert 1 <= rows <= sampling.rows_waiting


@given(crowds, budgets)
def test_the_least_and_the_most_urgent_get_half_each_or_all_that_they_need(
    crowd: list[Waiting], budget: int
) -> None:
    urgent = min(crowd, key=lambda sampling: (sampling.deadline, sampling.arrived))
    least = min(crowd, key=lambda sampling: (sampling.job.rows_left, *sampling.job.urgency))

    shares = share(crowd, budget)

    assert shares.get(least, 0) >= min(budget // 2, least.rows_waiting)
    assert shares.get(urgent, 0) >= min(budget // 2, urgent.rows_waiting)


@given(st.integers(1, BUDGET // 2), st.integers(1, 300))
def test_a_small_one_is_served_whole_beside_any_number_of_large_ones(small: int, many: int) -> None:
    large = [Waiting(age, 1024, 10) for age in range(many)]
    newest = Waiting(many, small)

    assert share([*large, newest])[newest] == small


@given(st.lists(st.integers(1, 60), min_size=1, max_size=12, unique=True), st.data())
def test_of_equal_ones_the_older_comes_first(ages: list[int], data: st.DataObject) -> None:
    crowd = [Waiting(age, 20) for age in data.draw(st.permutations(ages))]

    shares = share(crowd)

    by_age = sorted(crowd, key=lambda sampling: sampling.arrived)
    assert [shares.get(sampling, 0) for sampling in by_age] == [20, 20, 20, 4, *[0] * 8][
        : len(ages)
    ]


def test_a_near_deadline_is_met_however_many_small_ones_come_and_old_ones_wait() -> None:
    urgent = Waiting(30, 64, 10, deadline=1e10)
    alone = 10 * 64 // BUDGET
    old = [Waiting(age, 512, 100) for age in range(20)]

    assert ticks_until_done(urgent, old, lambda tick: Waiting(30 + tick, BUDGET)) <= 2 * alone + 1


def test_whoever_is_in_danger_goes_before_everybody_else() -> None:
    now = perf_counter()
    least, oldest = Waiting(1, 20), Waiting(0, 1024, 10)
    late = Waiting(2, 30, 100, deadline=now + 1.5)
    in_time = Waiting(3, 40, 5, deadline=now + 1.4)

    shares = share([least, oldest, late, in_time], tick_seconds=0.01)

    # A hundred ticks of 10 ms and 1.5 s to go; what it leaves is shared as ever.
    assert shares == {late: 30, least: 17, in_time: 17}


def test_a_large_one_goes_on_at_half_its_speed_however_many_small_ones_come() -> None:
    large = Waiting(0, 1024, 10)
    alone = 10 * 1024 // BUDGET

    assert ticks_until_done(large, [], lambda tick: Waiting(tick, BUDGET)) <= 2 * alone
    crowded = ticks_until_done(
        Waiting(0.5, 1024, 10),
        [Waiting(0, 1024, 10) for _ in range(3)],
        lambda tick: Waiting(tick, BUDGET),
    )
    # Not before it was the oldest, three of its kind later.
    assert crowded <= 4 * 2 * alone


def test_a_small_one_is_done_at_once_however_many_large_ones_come() -> None:
    crowd = [Waiting(age, 512, 100) for age in range(20)]

    assert ticks_until_done(Waiting(20, 16, 3), crowd, lambda tick: Waiting(20 + tick, 512, 9)) == 3
