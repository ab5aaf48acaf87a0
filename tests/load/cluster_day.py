"""A day of a large cluster, simulated: the routing and admission of app/deploy on replicas that are
a clock each. A second stands for most of an hour, of which it has the load and the failures.

What is simulated: ingresses that each know what replicas told them, a second ago or with an answer;
estimates that are wrong; replicas that die, whose work goes elsewhere, and come back. What is not:
the time that HTTP, Python and Ray take.
"""

import heapq
import math
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from app.deploy.routing import TRIES, Board, Load, Order
from tests.load.verdict import Verdict

SECONDS_PER_STEP = 1e-8
KINDS = ((0.7, 0.004, 1.0), (0.25, 0.04, 5.0), (0.05, 0.8, 20.0))
"""Of works: how often, seconds that they take, and their deadline, s."""
NOISE = 0.3
"""Standard deviation of the logarithm of what a work takes beside what it was expected to."""
BUSIEST, QUIETEST = 0.95, 0.25
"""Of what all replicas can do, at the busiest hour and at the quietest."""
REPORT_SECONDS = 1.0
DETECTION_SECONDS = 0.3
"""Until a call knows that its replica has died."""
NOTICE_SECONDS = 1.0
"""Until routers know it, too."""
RESTART_SECONDS = 10.0
MOST_LATE = 1.0
"""%, and of works that are refused."""

Event: TypeAlias = Callable[[float], None]
"""What happens at a time, s."""


@dataclass
class _Replica:
    """A clock of when it is free, and what it works on."""

    name: str
    free_at: float = 0.0
    busy: float = 0.0
    up_from: float = 0.0
    has_died: bool = False
    works: dict[int, Event] = field(default_factory=dict)
    """What is to happen with each that it works on, should it die."""

    def load(self, now: float) -> Load:
        return Load({}, {"plan": SECONDS_PER_STEP}, {"short": max(0.0, self.free_at - now)})


class ClusterDay:
    """The simulation.

    Args:
        replicas: how many.
        ingresses: how many, each with a board of its own.
        seconds: how long the day takes.
        deaths_per_second: of replicas.
        seed: decides everything.
    """

    def __init__(
        self, replicas: int, ingresses: int, seconds: float, deaths_per_second: float, seed: int
    ) -> None:
        self._rng = random.Random(seed)
        self._replicas = {f"replica {i}": _Replica(f"replica {i}") for i in range(replicas)}
        self._names = list(self._replicas)
        self._boards = [Board(random.Random(f"{seed} {i}")) for i in range(ingresses)]
        self._seconds = seconds
        self._deaths_per_second = deaths_per_second
        self._events: list[tuple[float, int, Event]] = []
        self._count = 0
        self.outcomes: Counter[str] = Counter()
        self.waits: list[float] = []
        """Seconds beyond what each answered work took itself."""

    def run(self) -> None:
        """Let the day go by."""
        for replica in self._replicas.values():
            self._at(self._rng.uniform(0, REPORT_SECONDS), self._reporting(replica))
            for board in self._boards:
                board.tell(replica.name, replica.load(0.0), 0.0)
        self._at(0.0, self._arrive)
        self._at(0.0, self._kill)
        while self._events:
            now, _, event = heapq.heappop(self._events)
            event(now)

    def check(self, verdict: Verdict) -> None:
        """Add what came of it."""
        asked = self.outcomes["asked"]
        ended = sum(self.outcomes[end] for end in ("answered", "late", "refused"))
        verdict.check("works without an answer or a refusal", asked - ended)
        verdict.check("answers that came late, %", 100 * self.outcomes["late"] / asked, MOST_LATE)
        verdict.check("works refused, %", 100 * self.outcomes["refused"] / asked, MOST_LATE)
        busy = [replica.busy for replica in self._replicas.values() if not replica.has_died]
        waits = np.percentile(self.waits, [50, 99, 99.9])
        verdict.note("asked", f"{asked} works, {self.outcomes['deaths']} replicas died")
        verdict.note("asked again", f"{self.outcomes['again']} works of replicas that died")
        verdict.note("sent on", f"{self.outcomes['sent on']} works that a replica refused")
        verdict.note("waited", "median, 99 %, 99.9 %: " + ", ".join(f"{w:.3g} s" for w in waits))
        verdict.note("busiest replica beside the mean", f"{max(busy) / np.mean(busy):.2f}")

    def _at(self, time: float, event: Event) -> None:
        self._count += 1
        heapq.heappush(self._events, (time, self._count, event))

    def _reporting(self, replica: _Replica) -> Event:
        def report(now: float) -> None:
            if now >= replica.up_from:
                for board in self._boards:
                    board.tell(replica.name, replica.load(now), now)
            if now < self._seconds:
                self._at(now + REPORT_SECONDS, report)

        return report

    def _arrive(self, now: float) -> None:
        """Let a work come, and the next one after it."""
        if now >= self._seconds:
            return
        share = 0.5 - 0.5 * math.cos(2 * math.pi * now / self._seconds)
        busy = QUIETEST + (BUSIEST - QUIETEST) * share
        mean = sum(often * seconds for often, seconds, _ in KINDS)
        self._at(now + self._rng.expovariate(busy * len(self._replicas) / mean), self._arrive)
        self.outcomes["asked"] += 1
        [(_, seconds, within)] = self._rng.choices(KINDS, [kind[0] for kind in KINDS])
        board = self._rng.choice(self._boards)
        order = Order(kind="plan", steps=round(seconds / SECONDS_PER_STEP))
        if board.soonest(order, within, now) > within:
            self.outcomes["refused"] += 1
        else:
            self._send(board, order, now, now, now + within, TRIES)

    def _send(
        self, board: Board, order: Order, now: float, asked: float, deadline: float, tries: int
    ) -> None:
        chosen = board.choose(order, self._names, now)
        if not tries or chosen is None:
            self.outcomes["refused"] += 1  # 503: one replica after the other has died
            return
        board.send(chosen, order, now)
        replica = self._replicas[chosen]
        again = order._replace(avoided=order.avoided | {chosen})
        if now < replica.up_from:
            self._retry(board, again, now, asked, deadline, tries)
            return
        expected = order.steps * SECONDS_PER_STEP
        if max(replica.free_at, now) + expected > deadline:
            board.tell(chosen, replica.load(now), now)
            if tries > 1:
                self.outcomes["sent on"] += 1
                self._send(board, again, now, asked, deadline, tries - 1)
            else:
                self.outcomes["refused"] += 1
            return
        seconds = expected * self._rng.lognormvariate(-(NOISE**2) / 2, NOISE)
        replica.free_at = max(replica.free_at, now) + seconds
        replica.busy += seconds
        number = self._count

        def done(at: float) -> None:
            if replica.works.pop(number, None) is None:
                return  # it died meanwhile
            board.tell(chosen, replica.load(at), at)
            self.outcomes["late" if at > deadline else "answered"] += 1
            self.waits.append(at - asked - seconds)

        replica.works[number] = lambda at: self._retry(board, again, at, asked, deadline, tries)
        self._at(replica.free_at, done)

    def _retry(
        self, board: Board, order: Order, now: float, asked: float, deadline: float, tries: int
    ) -> None:
        self.outcomes["again"] += 1
        self._at(
            now + DETECTION_SECONDS,
            lambda at: self._send(board, order, at, asked, deadline, tries - 1),
        )

    def _kill(self, now: float) -> None:
        if now >= self._seconds:
            return
        alive = [name for name in self._names if now >= self._replicas[name].up_from]
        replica = self._replicas[self._rng.choice(alive)]
        self._at(now + NOTICE_SECONDS, lambda _: self._leave(replica))
        self._at(now + RESTART_SECONDS, lambda at: self._come(replica, at))
        works, replica.works = replica.works, {}
        replica.has_died = True
        replica.up_from = replica.free_at = now + RESTART_SECONDS
        for work_again in works.values():
            work_again(now)
        self.outcomes["deaths"] += 1
        self._at(now + self._rng.expovariate(self._deaths_per_second), self._kill)

    def _leave(self, replica: _Replica) -> None:
        self._names = [name for name in self._names if name != replica.name]
        for board in self._boards:
            board.keep(self._names)

    def _come(self, replica: _Replica, now: float) -> None:
        self._names = [*self._names, replica.name]
        for board in self._boards:
            board.tell(replica.name, replica.load(now), now)


def cluster_day(replicas: int, ingresses: int, seconds: float, deaths: float, seed: int) -> Verdict:
    """Simulate a day, and judge it."""
    day = ClusterDay(replicas, ingresses, seconds, deaths, seed)
    day.run()
    verdict = Verdict(f"A day of {replicas} replicas and {ingresses} ingresses")
    day.check(verdict)
    return verdict
