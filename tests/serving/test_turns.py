"""Requests take turns: one in each round of the event loop, and none where the wait stays long."""

import asyncio
import time
from itertools import pairwise

import pytest

from app.serving.refusals import Refused
from app.serving.turns import INTERVAL_SECONDS, TARGET_SECONDS, Turns


async def ask(turns: Turns, name: str, order: list[str], reading_seconds: float = 0.0) -> None:
    await turns.take()
    order.append(name)
    time.sleep(reading_seconds)


def test_something_else_comes_in_between_and_the_first_goes_first() -> None:
    order: list[str] = []

    async def measure() -> None:
        for _ in range(20):
            order.append("step")
            await asyncio.sleep(0)

    async def scenario() -> None:
        turns = Turns()
        requests = [ask(turns, f"plan {number}", order) for number in range(5)]
        await asyncio.gather(*requests, measure())

    asyncio.run(scenario())
    plans = [name for name in order if name.startswith("plan")]
    assert plans == [f"plan {number}" for number in range(5)]
    places = [order.index(plan) for plan in plans]
    assert all(later - earlier > 1 for earlier, later in pairwise(places))


def test_who_leaves_while_it_waits_holds_up_nobody() -> None:
    order: list[str] = []

    async def scenario() -> None:
        turns = Turns()
        tasks = [asyncio.create_task(ask(turns, str(number), order)) for number in range(4)]
        await asyncio.sleep(0)
        tasks[1].cancel()
        tasks[2].cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.wait_for(ask(turns, "next", order), 1)

    asyncio.run(scenario())
    assert order == ["0", "3", "next"]


def test_a_queue_that_stays_refuses_who_comes_and_one_that_empties_takes_all_again() -> None:
    order: list[str] = []
    reading = 0.02
    many = 2 + int(2 * (TARGET_SECONDS + INTERVAL_SECONDS) / reading)

    async def scenario() -> None:
        turns = Turns()
        waiting = [
            asyncio.create_task(ask(turns, str(number), order, reading)) for number in range(many)
        ]
        began = time.perf_counter()
        while time.perf_counter() - began < TARGET_SECONDS + INTERVAL_SECONDS + 3 * reading:
            await asyncio.sleep(0)
        with pytest.raises(Refused) as refused:
            await turns.take()
        assert refused.value.reason == "overloaded"
        assert not all(task.done() for task in waiting), "it was refused at once"
        await asyncio.gather(*waiting)
        await asyncio.sleep(0)
        await turns.take()

    asyncio.run(scenario())
    assert order == [str(number) for number in range(many)], "who waited had its turn"


def test_a_short_crowd_is_refused_nothing() -> None:
    order: list[str] = []

    async def scenario() -> None:
        turns = Turns()
        await asyncio.gather(*(ask(turns, str(number), order, 0.005) for number in range(20)))

    asyncio.run(scenario())
    assert len(order) == 20
