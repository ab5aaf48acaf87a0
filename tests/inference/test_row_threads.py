"""Rows shared out over threads: each once, also where something goes wrong or others work too."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.inference.row_threads import ROWS_AT_A_TIME, RowThreads

TIMEOUT_S = 300


@contextmanager
def row_threads(num_threads: int) -> Iterator[RowThreads]:
    threads = RowThreads(num_threads)
    yield threads
    threads.close()


def times_worked_on(threads: RowThreads, rows: int) -> list[int]:
    counts = np.zeros(rows, int)

    def work(part: slice) -> None:
        assert part.start < part.stop <= min(part.start + ROWS_AT_A_TIME, rows)
        counts[part] += 1

    threads.share(rows, work)
    return counts.tolist()


def together(work: Callable[[], None]) -> Callable[[slice], None]:
    """Let two threads meet in their slices, so that each has one."""
    meeting = threading.Barrier(2)

    def meet_and_work(_: slice) -> None:
        meeting.wait(TIMEOUT_S)
        work()

    return meet_and_work


@given(rows=st.integers(1, 300), num_threads=st.integers(1, 6))
def test_every_row_is_worked_on_once(rows: int, num_threads: int) -> None:
    with row_threads(num_threads) as threads:
        assert times_worked_on(threads, rows) == [1] * rows


def test_the_caller_and_a_helper_work_at_the_same_time() -> None:
    workers: list[threading.Thread] = []
    with row_threads(2) as threads:
        threads.share(16, together(lambda: workers.append(threading.current_thread())))

    assert len(set(workers)) == 2
    assert threading.current_thread() in workers


def test_a_row_or_two_wake_nobody() -> None:
    workers = []
    with row_threads(4) as threads:
        for rows in (1, 2):
            threads.share(rows, lambda _: workers.append(threading.current_thread()))

    assert set(workers) == {threading.current_thread()}


@pytest.mark.parametrize("in_helper", [False, True], ids=["in the caller", "in a helper"])
def test_an_exception_reaches_the_caller_and_the_threads_live_on(in_helper: bool) -> None:
    caller = threading.current_thread()

    def fail() -> None:
        if (threading.current_thread() is not caller) == in_helper:
            raise ArithmeticError("this row")

    with row_threads(2) as threads:
        for _ in range(3):
            with pytest.raises(ArithmeticError, match="this row"):
                threads.share(16, together(fail))
        assert times_worked_on(threads, 100) == [1] * 100
        # And still two of them.
        threads.share(16, together(lambda: None))


def test_a_lent_core_has_no_helper_until_it_is_given_back() -> None:
    with row_threads(2) as threads:
        workers = set()
        with threads.lend():
            assert threads.lent == 1
            threads.share(100, lambda _: workers.add(threading.current_thread()))
        assert workers == {threading.current_thread()}
        assert threads.lent == 0
        threads.share(16, together(lambda: None))


def test_cores_are_lent_and_given_back_from_any_thread_and_after_any_end() -> None:
    def lend(turn: int) -> None:
        with suppress(ArithmeticError), threads.lend():
            assert threads.lent >= 1
            if turn % 2:
                raise ArithmeticError

    with row_threads(3) as threads, ThreadPoolExecutor(8) as borrowers:
        list(borrowers.map(lend, range(2000)))
        assert threads.lent == 0


def test_callers_at_once_do_not_mix() -> None:
    with row_threads(3) as threads, ThreadPoolExecutor(4) as callers:
        results = callers.map(lambda rows: times_worked_on(threads, rows), [50, 3, 120, 17] * 25)

        assert list(results) == [[1] * rows for rows in [50, 3, 120, 17] * 25]
