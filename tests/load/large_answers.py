"""Many answers of 17 MB at once: does the service answer others, and get its memory back?"""

import asyncio
import random
from collections.abc import Awaitable, Callable, Sequence
from time import perf_counter

import psutil

from app.launch import ServerProcess, launch
from tests.load.connections import Connections
from tests.load.large_clients import (
    OK,
    REFUSED,
    Address,
    ignore_answer,
    large_request,
    take_answer,
)
from tests.load.probe import PROBE_SECONDS, probing
from tests.load.verdict import Verdict, percentile

WARM_UP_CLIENTS = 2
READING_SECONDS = 8.0
SEND_TIMEOUT_SECONDS = 2
DROPPING_SECONDS = 60.0
"""How long clients that do not read wait for the end, which comes after the time above."""
GROWTH_MB = 50.0
SETTLING_SECONDS = 1.0
POLL_SECONDS = 0.02
COMING_BACK_SECONDS = (0.5, 1.5)
"""How long a client waits that was refused; as with real ones, not all as long."""


async def large_answers(crowds: Sequence[int]) -> Verdict:
    """Start a service, and have it make large answers for crowds of clients.

    Args:
        crowds: how many clients, in one crowd after the other. All of them ask at once: first they
            read, and ask again; then they do not read, until they are dropped. Who is refused comes
            back.
    """
    sizes = " and ".join(map(str, crowds))
    verdict = Verdict(f"answers of 17 MB to {sizes} clients at once")
    with launch("app", "serve", "--send-timeout-s", str(SEND_TIMEOUT_SECONDS)) as server:
        await _crowd(Verdict("warm-up"), server, WARM_UP_CLIENTS, "read", _read)
        for size in crowds:
            await _crowd(verdict, server, size, "read", _read)
            await _crowd(verdict, server, size, "never read", _never_read)
    return verdict


async def _crowd(
    verdict: Verdict,
    server: ServerProcess,
    size: int,
    what: str,
    be_a_client: Callable[[Address], Awaitable[bool]],
) -> None:
    """Have `size` clients come at once, and check what became of them, of `/livez` and memory."""
    address = Connections(server.url).address
    process = psutil.Process(server.process.pid)
    before = most = _memory_mb(process)

    async def watch_memory() -> None:
        nonlocal most
        while True:
            most = max(most, _memory_mb(process))
            await asyncio.sleep(POLL_SECONDS)

    watch = asyncio.create_task(watch_memory())
    started = perf_counter()
    async with probing(server.url) as probes:
        served = await asyncio.gather(*(be_a_client(address) for _ in range(size)))
    seconds = perf_counter() - started
    await asyncio.sleep(SETTLING_SECONDS)
    watch.cancel()
    after = _memory_mb(process)
    name = f"{size} {what}"
    wrong = "without a whole answer" if be_a_client is _read else "not dropped"
    verdict.check(f"{name}: {wrong}", size - sum(served))
    slow = 1e3 * percentile(probes.latencies, 0.99)
    limit = 1e3 * PROBE_SECONDS
    verdict.check(f"{name}: /livez, 99th percentile", slow, limit, "ms", is_timing=True)
    verdict.check(f"{name}: /livez failed", probes.failures)
    verdict.check(f"{name}: resident memory grew", after - before, GROWTH_MB, "MB")
    verdict.note(
        name,
        f"{seconds:.1f} s; /livez {1e3 * percentile(probes.latencies, 0.5):.0f} ms in the middle, "
        f"{1e3 * max(probes.latencies):.0f} ms at worst of {len(probes.latencies)}; resident "
        f"memory {before:.0f} MB before, {most:.0f} MB at most, {after:.0f} MB after",
    )


def _memory_mb(process: psutil.Process) -> float:
    return float(process.memory_info().rss) / 1e6


async def _wait_to_come_back() -> None:
    await asyncio.sleep(random.uniform(*COMING_BACK_SECONDS))


async def _read(address: Address) -> bool:
    """Ask again and again; return whether there were answers, and all of them whole."""
    request = large_request()
    end = perf_counter() + READING_SECONDS
    was_served = False
    while perf_counter() < end or not was_served:
        taken = await take_answer(address, request, keep=False)
        if not taken.is_whole or taken.status not in (OK, REFUSED):
            return False
        if taken.status == REFUSED:
            await _wait_to_come_back()
        else:
            was_served = True
    return was_served


async def _never_read(address: Address) -> bool:
    """Ask until there is an answer; return whether the service ended the connection."""
    request = large_request()
    end = perf_counter() + DROPPING_SECONDS
    while perf_counter() < end:
        outcome = await ignore_answer(address, request, end - perf_counter())
        if outcome != "refused":
            return outcome == "dropped"
        await _wait_to_come_back()
    return False
