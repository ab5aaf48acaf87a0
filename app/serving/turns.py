"""Requests take turns in the event loop, and are turned away where more come than it can read.

To read, check and refuse a request takes milliseconds of the one thread that also hears
measurements of control sessions, sends answers and answers probes. So it reads one in each round,
and does all else in between. Where the wait for a turn stays long, the deadlines of all that was
taken on are in danger; those that come are refused unread then. The rule is that of controlled
delay (Nichols and Jacobson 2012, "Controlling queue delay"): a queue that empties now and then is
none to worry about, one that stays is.
"""

import asyncio
from collections import deque
from math import inf
from time import perf_counter

from app.serving.refusals import Refused

TARGET_SECONDS = 0.15
"""A request may wait so long for its turn: a few dozen clients that ask again and again do."""
INTERVAL_SECONDS = 0.1
"""And all of them longer for so long: a large body, or another process, takes no more."""


class Turns:
    """Whose turn it is in the running event loop: first come, first served."""

    def __init__(self) -> None:
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._is_taken = False
        self._late_since = inf
        self._is_overloaded = False

    async def take(self) -> None:
        """Wait for a turn, which lasts until the caller next waits for something.

        Raises:
            Refused: all have had to wait long for a while, and there are still some.
        """
        came, loop = perf_counter(), asyncio.get_running_loop()
        if came - self._late_since > INTERVAL_SECONDS:
            self._is_overloaded = True
        if self._is_overloaded:
            raise Refused("overloaded", "more requests come than can be read", 1.0)
        if self._is_taken:
            turn = loop.create_future()
            self._waiting.append(turn)
            await turn
        self._is_taken = True
        loop.call_soon(self._pass_on)
        now = perf_counter()
        self._late_since = inf if now - came <= TARGET_SECONDS else min(self._late_since, now)

    def _pass_on(self) -> None:
        self._is_taken = False
        while self._waiting and not self._is_taken:
            turn = self._waiting.popleft()
            if not turn.done():  # nobody waits any more for one that is cancelled
                turn.set_result(None)
                self._is_taken = True
        if not self._is_taken:
            self._is_overloaded, self._late_since = False, inf
