"""Cores go from thread to thread, in the order in which they were asked for."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from hypothesis import given
from hypothesis import strategies as st

from app.launch import START_SECONDS
from app.serving.cores import Cores


def start(target: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    time.sleep(0.02)  # so that it is the next to ask
    return thread


def test_who_came_first_goes_first() -> None:
    cores, order, gate = Cores(1), list[int](), threading.Event()

    def work(number: int) -> None:
        with cores.one(threading.Event()):
            order.append(number)
            gate.wait(START_SECONDS)

    threads = [start(lambda number=number: work(number)) for number in range(4)]  # type: ignore[misc]
    assert order == [0]
    gate.set()
    for thread in threads:
        thread.join(START_SECONDS)
    assert order == [0, 1, 2, 3]


def test_who_is_called_away_has_none_and_the_next_one_does() -> None:
    cores, gate, had = Cores(1), threading.Event(), dict[str, bool]()
    called = {name: threading.Event() for name in ("first", "second", "third")}

    def work(name: str) -> None:
        with cores.one(called[name]) as is_there:
            had[name] = is_there
            gate.wait(START_SECONDS)

    threads = [start(lambda name=name: work(name)) for name in called]  # type: ignore[misc]
    called["second"].set()
    time.sleep(0.05)
    assert had == {"first": True, "second": False}
    gate.set()
    for thread in threads:
        thread.join(START_SECONDS)
    assert had == {"first": True, "second": False, "third": True}


def test_who_was_called_away_before_it_came_does_not_wait() -> None:
    cores, called = Cores(0), threading.Event()
    called.set()
    with cores.one(called) as is_there:
        assert not is_there


def test_more_cores_are_taken_at_once_and_fewer_are_given_back_first() -> None:
    cores, gate, begun = Cores(1), threading.Event(), list[int]()

    def work() -> None:
        with cores.one(threading.Event()):
            begun.append(0)
            gate.wait(START_SECONDS)

    threads = [start(work) for _ in range(3)]
    assert len(begun) == 1
    cores.set_number(2)
    time.sleep(0.05)
    assert len(begun) == 2
    cores.set_number(0)
    gate.set()
    time.sleep(0.05)
    assert len(begun) == 2
    cores.set_number(1)
    for thread in threads:
        thread.join(START_SECONDS)
    assert len(begun) == 3


@given(number=st.integers(1, 4), works=st.integers(1, 12), away=st.sets(st.integers(0, 11)))
def test_never_more_than_there_are_and_none_is_lost(
    number: int, works: int, away: set[int]
) -> None:
    cores, lock, now, most = Cores(number), threading.Lock(), 0, 0
    events = [threading.Event() for _ in range(works)]

    def work(index: int) -> bool:
        nonlocal now, most
        with cores.one(events[index]) as is_there:
            if is_there:
                with lock:
                    now += 1
                    most = max(most, now)
                time.sleep(0.0005)
                with lock:
                    now -= 1
            return is_there

    with ThreadPoolExecutor(works) as threads:
        had = [threads.submit(work, index) for index in range(works)]
        for index in away & set(range(works)):
            events[index].set()
        assert all(future.result(START_SECONDS) for i, future in enumerate(had) if i not in away)
    assert most <= number
    with cores.one(threading.Event()) as is_there:
        assert is_there
