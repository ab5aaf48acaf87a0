"""Clients that ask for 17 MB, and read it or never do."""

import asyncio
import gzip
import json
import random
import re
import select
import socket
from collections import Counter
from contextlib import suppress
from time import perf_counter
from typing import Literal, NamedTuple, TypeAlias

from tests.load.connections import END_OF_HEAD, request_head
from tests.load.rubbish import GOOD
from tests.load.verdict import Verdict

ROUTE = "/plan"
LARGE = GOOD | {
    "method": "uniform",
    "num_candidates": 4096,
    "horizon": 81,
    "include": ["states", "candidates"],
    "reachability": False,
}
"""A million numbers, the most that may be asked for by default."""
TIMING = re.compile(rb'"timing_ms":\{[^}]*\}')
NUM_READING, NUM_IGNORING = 1, 3
"""Clients beside those of a run."""
LONGEST_PAUSE_SECONDS = 2.0
KEPT_SECONDS = 60.0
"""A client that never reads should be dropped by then: the send timeout, twice."""
COMING_BACK_SECONDS = 1.0
"""How long a client waits that was refused."""
RECEIVED_AT_ONCE = 1 << 18
POLL_SECONDS = 0.02
OK, REFUSED = 200, 429
REFUSAL = b"HTTP/1.1 429"
GZIP = b"\x1f\x8b"

Address: TypeAlias = tuple[str, int]


class Taken(NamedTuple):
    """What came to a client that reads; status 0 where nothing did."""

    status: int
    is_whole: bool
    body: bytearray = bytearray()
    """Empty unless it is whole and was to be kept."""


class LargeClients:
    """A few such clients beside those of a run, and what came of them.

    Args:
        address: of the service.
        seed: decides who accepts gzip, and the pauses.
    """

    def __init__(self, address: Address, seed: int) -> None:
        self._address = address
        self._rng = random.Random(f"large {seed}")
        self._first: bytes | None = None
        self._unlike = self._kept = 0
        self.statuses: Counter[int] = Counter()
        """Of all their requests, as the service should have counted them."""
        self._events: Counter[str] = Counter()

    async def go_on_until(self, end: float) -> None:
        """Ask again and again until then (by `perf_counter`); return when all are served."""
        async with asyncio.TaskGroup() as tasks:
            for _ in range(NUM_READING):
                tasks.create_task(self._read_until(end))
            for _ in range(NUM_IGNORING):
                tasks.create_task(self._ignore_until(end))

    async def _read_until(self, end: float) -> None:
        while perf_counter() < end:
            encoding = self._rng.choice(["identity", "gzip"])
            taken = await take_answer(self._address, large_request(encoding))
            self.statuses[taken.status] += 1
            self._events["refused" if taken.status == REFUSED else f"read, {encoding}"] += 1
            if taken.status != REFUSED:
                self._unlike += not await asyncio.to_thread(self._is_like_first, taken)
            await asyncio.sleep(self._rng.uniform(0, LONGEST_PAUSE_SECONDS))

    def _is_like_first(self, taken: Taken) -> bool:
        if taken.status != OK or not taken.is_whole:
            return False
        is_gzip = taken.body.startswith(GZIP)
        text = TIMING.sub(b"", gzip.decompress(taken.body) if is_gzip else taken.body, count=1)
        if self._first is None:
            self._first = text
        return text == self._first

    async def _ignore_until(self, end: float) -> None:
        request = large_request()
        while perf_counter() < end:
            outcome = await ignore_answer(self._address, request, KEPT_SECONDS)
            self.statuses[REFUSED if outcome == "refused" else OK] += 1
            self._events[f"never read, {outcome}"] += 1
            self._kept += outcome == "kept"
            if outcome == "refused":
                await asyncio.sleep(COMING_BACK_SECONDS)

    def check(self, verdict: Verdict) -> None:
        """Check what came of them."""
        verdict.check("answers of 17 MB that were not whole and like the first", self._unlike)
        verdict.check("clients that never read and were kept", self._kept)
        events = sorted(self._events.items())
        verdict.note("answers of 17 MB", ", ".join(f"{n} x {event}" for event, n in events))


def large_request(encoding: str = "identity") -> bytes:
    """Return the request for a large answer, whole."""
    content: bytes = json.dumps(LARGE).encode()
    return request_head(ROUTE, len(content), {"Accept-Encoding": encoding}) + content


async def take_answer(address: Address, request: bytes, *, keep: bool = True) -> Taken:
    """Ask, and read the answer as fast as it comes.

    Args:
        address: of the service.
        request: what to send.
        keep: the body; it takes time that a crowd of clients has not.
    """
    loop = asyncio.get_running_loop()
    status, received = 0, bytearray()
    with suppress(ConnectionError), socket.socket() as connection:
        connection.setblocking(False)
        await loop.sock_connect(connection, address)
        await loop.sock_sendall(connection, request)
        while END_OF_HEAD not in received:
            part = await loop.sock_recv(connection, RECEIVED_AT_ONCE)
            if not part:
                return Taken(0, False)
            received += part
        head, _, body = received.partition(END_OF_HEAD)
        status = int(head.split()[1])
        length = re.search(rb"(?i)\r\ncontent-length: *(\d+)", head)
        assert length is not None
        missing = int(length[1]) - len(body)
        buffer = memoryview(bytearray(RECEIVED_AT_ONCE))
        while missing:
            num_bytes = await loop.sock_recv_into(connection, buffer)
            if not num_bytes:
                return Taken(status, False)
            missing -= num_bytes
            if keep:
                body += buffer[:num_bytes]
        return Taken(status, True, body)
    return Taken(status, False)


async def ignore_answer(
    address: Address, request: bytes, seconds: float
) -> Literal["refused", "dropped", "kept"]:
    """Ask, and leave the answer lying; say what the service did about it in that time."""
    loop = asyncio.get_running_loop()
    end = perf_counter() + seconds
    with socket.socket() as connection:
        connection.setblocking(False)
        await loop.sock_connect(connection, address)
        await loop.sock_sendall(connection, request)
        poll = select.poll()
        poll.register(connection, select.POLLIN)
        while not poll.poll(0) and perf_counter() < end:
            await asyncio.sleep(POLL_SECONDS)
        with suppress(OSError):  # nothing is there, or it was dropped already
            if connection.recv(len(REFUSAL), socket.MSG_PEEK) == REFUSAL:
                return "refused"
        poll.modify(connection, 0)  # an error or the end is told all the same
        while not poll.poll(0):
            if perf_counter() > end:
                return "kept"
            await asyncio.sleep(POLL_SECONDS)
    return "dropped"
