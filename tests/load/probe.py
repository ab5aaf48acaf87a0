"""Asks `/livez` over and over, and notes how long each answer takes."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from time import perf_counter

import httpx

PERIOD_SECONDS = 0.02
TIMEOUT_SECONDS = 5.0
PROBE_SECONDS = 0.05
"""How soon 99 % of the answers have to come."""


@dataclass
class Probes:
    """The answers so far."""

    latencies: list[float] = field(default_factory=list)
    """s."""
    failures: int = 0


@asynccontextmanager
async def probing(url: str) -> AsyncIterator[Probes]:
    """Probe the service at `url` until the context ends."""
    probes = Probes()

    async def probe() -> None:
        async with httpx.AsyncClient(base_url=url, timeout=TIMEOUT_SECONDS) as client:
            while True:
                started = perf_counter()
                try:
                    is_alive = (await client.get("/livez")).is_success
                except httpx.TransportError:
                    is_alive = False
                probes.latencies.append(perf_counter() - started)
                probes.failures += not is_alive
                await asyncio.sleep(PERIOD_SECONDS)

    task = asyncio.create_task(probe())
    try:
        yield probes
    finally:
        task.cancel()
