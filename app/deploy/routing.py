"""Which replica takes which work, and when it would be done: arithmetic on what replicas say.

No Ray in here: router.py asks this for every request, and tests/load/cluster_day.py simulates a day
of a thousand replicas with it.
"""

import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from math import inf
from time import perf_counter
from typing import Literal, NamedTuple, TypeAlias

from app.serving.admission import SHORT_SECONDS
from app.serving.rates import SECONDS_PER_STEP

CHOICES = 4
"""Of so many replicas, drawn at random, the one that is done first takes a work: several ingresses
that all know the same a moment late would else all send theirs to the same one."""

TRIES = 4
"""A call is made again elsewhere when its replica dies, or has no time for it; not for ever."""

Lane: TypeAlias = Literal["network", "short", "long"]


class Order(NamedTuple):
    """What a work takes, as far as routing is concerned."""

    model: str | None = None
    """The label of the model that it needs."""
    rows: int = 0
    """Through the model's network."""
    kind: str = ""
    steps: int = 0
    """Simulated time steps, of that kind of plan."""
    is_batch: bool = False
    pinned: str | None = None
    """The replica that takes it as long as it lives."""
    avoided: frozenset[str] = frozenset()
    """Replicas that died of it, or refused it."""


@dataclass(frozen=True, slots=True)
class Load:
    """What a replica says of itself, every second and with each answer."""

    models: Mapping[str, float] = field(default_factory=dict)
    """The models that it holds, by label, and the seconds that a row takes."""
    kinds: Mapping[str, float] = field(default_factory=dict)
    """Seconds that a simulated time step takes, by kind of plan."""
    queued: Mapping[Lane, float] = field(default_factory=dict)
    """Seconds until all in a lane is done that waits there."""


class Board:
    """What is known of every replica, and what was sent to it since.

    Seconds queued are taken to run down as time goes by; what was sent meanwhile is added.

    Args:
        rng: draws the replicas among which one is chosen.
    """

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._loads: dict[str, Load] = {}
        self._free_at: dict[str, dict[Lane, float]] = {}
        self._names: list[str] = []

    def __len__(self) -> int:
        """Of how many replicas anything is known."""
        return len(self._names)

    def tell(self, replica: str, load: Load, now: float) -> None:
        """Take down what a replica says of itself at `now`, s: all that was sent is in it."""
        if replica not in self._loads:
            self._names = [*self._names, replica]
        self._loads[replica] = load
        self._free_at[replica] = {lane: now + seconds for lane, seconds in load.queued.items()}

    def keep(self, replicas: Collection[str]) -> None:
        """Forget all but these."""
        for gone in self._loads.keys() - set(replicas):
            del self._loads[gone], self._free_at[gone]
        self._names = list(self._loads)

    def send(self, replica: str, order: Order, now: float) -> None:
        """Count a work as one more that waits at a replica."""
        if load := self._loads.get(replica):
            seconds = _seconds(order, load)
            free_at = self._free_at[replica]
            lane = _lane(order, seconds)
            free_at[lane] = max(free_at.get(lane, now), now) + seconds

    def finish(self, replica: str, order: Order, now: float) -> tuple[float, float]:
        """Return in how many seconds a replica would have done a work, and how many wait there.

        Half of an engine goes to whoever has the least left: a small work is done in twice its own
        time at most, however much waits. What is computed without a network queues.
        """
        load = self._loads[replica]
        if order.model is not None and order.model not in load.models:
            return inf, inf
        seconds = _seconds(order, load)
        lane = _lane(order, seconds)
        queued = max(0.0, self._free_at[replica].get(lane, now) - now)
        waiting = min(queued, seconds) if lane == "network" else queued
        return waiting + seconds, queued

    def soonest(self, order: Order, within: float, now: float) -> float:
        """Return in how many seconds a replica could have done a work, at best or soon enough.

        Args:
            order: the work.
            within: what is soon enough, s: the search ends with the first such replica.
            now: the time, s.

        Returns:
            Infinity where no replica holds its model; 0 where nothing is known of any yet.
        """
        soonest = inf if self._names else 0.0
        first = self._rng.randrange(len(self._names) or 1)
        for replica in chain(self._names[first:], self._names[:first]):
            soonest = min(soonest, self.finish(replica, order, now)[0])
            if soonest <= within:
                break
        return soonest

    def choose(self, order: Order, replicas: Sequence[str], now: float) -> str | None:
        """Return which of these replicas takes a work; None if there are none.

        The one that it is pinned to, or else the first to have it done of `CHOICES`. A replica that
        has said nothing of itself yet, or holds other models, is taken where there is none better.
        """
        if order.pinned in replicas:
            return order.pinned
        drawn = self._rng.sample(replicas, min(CHOICES, len(replicas)))
        if not any(self._suits(replica, order) for replica in drawn):
            drawn = [replica for replica in replicas if self._suits(replica, order)]
        suited = [replica for replica in drawn if self._suits(replica, order)]
        if suited:
            return min(suited, key=lambda replica: self.finish(replica, order, now))
        able = [replica for replica in replicas if replica not in order.avoided]
        return self._rng.choice(able) if able else None

    def _suits(self, replica: str, order: Order) -> bool:
        load = self._loads.get(replica)
        if load is None or replica in order.avoided:
            return False
        return order.model is None or order.model in load.models


def _seconds(order: Order, load: Load) -> float:
    per_row = load.models.get(order.model, 0.0) if order.model else 0.0
    return order.rows * per_row + order.steps * load.kinds.get(order.kind, SECONDS_PER_STEP)


def _lane(order: Order, seconds: float) -> Lane:
    if order.model:
        return "network"
    return "long" if order.is_batch or seconds > SHORT_SECONDS else "short"


BOARD = Board(random.Random())
"""That of this process: its router reads it in a thread of Ray's, and what comes back is told to it
in the event loop of the service."""


def now() -> float:
    """Return the time by which the board of a process goes, s."""
    return perf_counter()
