"""Several times more requests than the service can answer, each with a deadline."""

import asyncio
import math
import random
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from time import perf_counter, process_time
from typing import NamedTuple

import psutil

from tests.load.client import Answer, Metrics, ServiceClient
from tests.load.large_clients import ROUTE, LargeClients
from tests.load.probe import PROBE_SECONDS, probing
from tests.load.scenario import Question, question
from tests.load.session_clients import SessionClients
from tests.load.verdict import Verdict, percentile

NUM_CLIENTS = 16
"""Of the closed loop: enough to keep every core of a server busy."""
LONGEST_CALIBRATION_SECONDS = 25.0
SETTLING_SECONDS = 2.0
REJECTION_SECONDS = 0.020
GROWTH_MB = 50.0


class Outcome(NamedTuple):
    """A request and what became of it."""

    asked: Question
    answer: Answer

    @property
    def overdue(self) -> float:
        """By how much the answer missed its deadline, by the client's clock; s."""
        return self.answer.latency - self.asked.deadline_ms / 1e3


@dataclass
class Load:
    """A stretch of load and what came of it."""

    outcomes: list[Outcome] = field(default_factory=list)
    seconds: float = 0.0
    generator_cores: float = 0.0
    """Cores that this process kept busy."""
    machine_cores: float = 0.0
    """Cores of this machine that were busy."""
    lateness: float = 0.0
    """s: by how much a request was sent late at worst."""

    def add(self, asked: Question, answer: Answer) -> None:
        """Note an answer, without its body: of so many the generator would hold gigabytes."""
        self.outcomes.append(Outcome(asked, answer._replace(body=None)))

    def of_status(self, *statuses: int) -> list[Outcome]:
        return [outcome for outcome in self.outcomes if outcome.answer.status in statuses]

    @property
    def plans_per_second(self) -> float:
        return len(self.of_status(200)) / self.seconds

    @property
    def rows_per_second(self) -> float:
        return sum(outcome.asked.rows for outcome in self.of_status(200)) / self.seconds


async def overload(url: str, seconds: float, factor: float, seed: int) -> Verdict:
    """Measure the service's capacity, then ask for `factor` times as much.

    Args:
        url: where the service is.
        seconds: how long the load lasts; capacity and warm-up take up to a quarter of that each.
        factor: of the capacity.
        seed: decides the requests and when they come.
    """
    calibration = min(LONGEST_CALIBRATION_SECONDS, seconds / 4)
    indices = count()
    async with ServiceClient(url) as service:
        (await service.http.get("/readyz")).raise_for_status()
        capacity = await _closed_loop(service, calibration, seed, indices)
        rate = factor * capacity.plans_per_second
        await _open_loop(service, rate, calibration, seed, indices)
        await asyncio.sleep(SETTLING_SECONDS)
        before = await service.metrics()
        large_clients = LargeClients(service.connections.address, seed)
        session_clients = SessionClients(url, seed)
        async with probing(url) as probes, asyncio.TaskGroup() as tasks:
            tasks.create_task(large_clients.go_on_until(perf_counter() + seconds))
            tasks.create_task(session_clients.go_on_until(perf_counter() + seconds))
            load = await _open_loop(service, rate, seconds, seed, indices)
        await asyncio.sleep(SETTLING_SECONDS)
        after = await service.metrics()

    verdict = Verdict(f"{rate:.0f} requests a second for {seconds:.0f} s: {factor:g} x capacity")
    _check_answers(verdict, load, large_clients, before, after)
    session_clients.check(verdict, after)
    slow = 1e3 * percentile(probes.latencies, 0.99)
    verdict.check("/livez, 99th percentile", slow, 1e3 * PROBE_SECONDS, "ms", is_timing=True)
    verdict.check("/livez failed", probes.failures)
    verdict.check("resident memory grew", after.memory_mb - before.memory_mb, GROWTH_MB, "MB")
    _note(verdict, capacity, load, before, after)
    return verdict


async def _closed_loop(
    service: ServiceClient, seconds: float, seed: int, indices: Iterator[int]
) -> Load:
    """Have some clients ask one question after the other, with all the time in the world."""
    with _measuring() as load:
        end = perf_counter() + seconds

        async def ask_on() -> None:
            while perf_counter() < end:
                asked = question(seed, next(indices))
                answer = await service.ask(asked.route, asked.body)
                load.add(asked, answer)

        async with asyncio.TaskGroup() as clients:
            for _ in range(NUM_CLIENTS):
                clients.create_task(ask_on())
    return load


async def _open_loop(
    service: ServiceClient, rate: float, seconds: float, seed: int, indices: Iterator[int]
) -> Load:
    """Send requests at random times, `rate` a second on average, whatever becomes of them."""
    with _measuring() as load:

        async def ask(index: int) -> None:
            asked = question(seed, index)
            body = asked.body | {"deadline_ms": asked.deadline_ms}
            answer = await service.ask(asked.route, body)
            load.add(asked, answer)

        rng = random.Random(f"arrivals {seed}")
        start = perf_counter()
        due = rng.expovariate(rate)
        async with asyncio.TaskGroup() as requests:
            while due < seconds:
                await asyncio.sleep(start + due - perf_counter())
                load.lateness = max(load.lateness, perf_counter() - start - due)
                requests.create_task(ask(next(indices)))
                due += rng.expovariate(rate)
    return load


@contextmanager
def _measuring() -> Iterator[Load]:
    load = Load()
    started, own, all_cores = perf_counter(), process_time(), _busy_seconds()
    yield load
    load.seconds = perf_counter() - started
    load.generator_cores = (process_time() - own) / load.seconds
    load.machine_cores = (_busy_seconds() - all_cores) / load.seconds


def _busy_seconds() -> float:
    """Return the seconds that all processes together have had of this machine's cores."""
    times = psutil.cpu_times()
    return float(times.user + times.nice + times.system)


def _check_answers(
    verdict: Verdict, load: Load, large_clients: LargeClients, before: Metrics, after: Metrics
) -> None:
    answers = [outcome.answer for outcome in load.outcomes]
    ours = Counter((answer.route, answer.status) for answer in answers)
    ours += Counter({(ROUTE, status): n for status, n in large_clients.statuses.items()})
    theirs = Counter(after.answered) - Counter(before.answered)
    verdict.check("requests without an answer", len(load.of_status(0)))
    verdict.check("answers to something else", sum(not a.is_own for a in answers if a.status))
    verdict.check(
        "answers that only one side has counted", ((ours - theirs) + (theirs - ours)).total()
    )
    verdict.check("errors of the server (500 and others)", _errors(load))
    verdict.check("not ready (503)", len(load.of_status(503)))
    verdict.check("admitted and not in time (504)", len(load.of_status(504)), is_timing=True)
    large_clients.check(verdict)
    rejections = [outcome.answer.latency for outcome in load.of_status(429)]
    if rejections:
        middle = 1e3 * percentile(rejections, 0.5)
        verdict.check("rejections, median", middle, 1e3 * REJECTION_SECONDS, "ms", is_timing=True)


def _errors(load: Load) -> int:
    return sum(o.answer.status >= 500 and o.answer.status not in (503, 504) for o in load.outcomes)


def _note(verdict: Verdict, capacity: Load, load: Load, before: Metrics, after: Metrics) -> None:
    for name, part in (("capacity", capacity), ("goodput", load)):
        verdict.note(
            name,
            f"{part.plans_per_second:.1f} plans/s, {part.rows_per_second:.0f} rows of the "
            f"network/s ({len(part.outcomes)} requests in {part.seconds:.1f} s)",
        )
    in_time = load.of_status(200)
    worst = max((outcome.overdue for outcome in in_time), default=math.nan)
    verdict.note(
        "latest answer, by the client's clock, beside its deadline", f"{1e3 * worst:+.0f} ms"
    )
    statuses = Counter(outcome.answer.status for outcome in load.outcomes)
    verdict.note("answers", ", ".join(f"{n} x {status}" for status, n in sorted(statuses.items())))
    old = before.by("breakaway_rejected_total", "reason")
    new = after.by("breakaway_rejected_total", "reason")
    rejected = {reason: value - old.get(reason, 0.0) for reason, value in new.items()}
    verdict.note("rejected", ", ".join(f"{n:.0f} x {r}" for r, n in rejected.items()) or "none")
    cores = (after.cpu_seconds - before.cpu_seconds) / load.seconds
    verdict.cores_of_others = max(0.0, load.machine_cores - load.generator_cores - cores)
    verdict.note(
        "cores busy",
        f"{cores:.2f} with the server, {load.generator_cores:.2f} with these requests, "
        f"{verdict.cores_of_others:.2f} with something else",
    )
    verdict.note("sent late at worst", f"{1e3 * load.lateness:.0f} ms")
    verdict.note(
        "resident memory", f"{before.memory_mb:.0f} MB before, {after.memory_mb:.0f} MB after"
    )
