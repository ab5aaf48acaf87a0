"""What the way over a cluster costs beside the plain service, in one run on one machine.

`python -m tests.deploy.overhead`: each kind of plan one after the other and over many connections,
by the plain service and by one and two replicas of a core each.
"""

import asyncio
import statistics
from time import perf_counter
from typing import Any

import click
import httpx

from app.launch import launch

BODY = {"initial_state": [0, 0], "target_state": [0.2, 0], "num_candidates": 16, "include": []}
KINDS: dict[str, dict[str, Any]] = {
    "cem K = 16": {"method": "cem"},
    "action_diffusion K = 16": {"method": "action_diffusion"},
}
WARM_UP, ONE_BY_ONE, CONNECTIONS = 30, 200, 16


@click.command()
@click.option("--seconds", default=5.0, show_default=True, help="Of each measurement of many.")
def overhead(seconds: float) -> None:
    """Measure, and print a line for each kind and service."""
    cluster = "tests.deploy.service"
    with launch("app", "serve", "--log-level", "warning") as plain:
        _tell("plain service", plain.url, seconds)
        with launch(cluster, "--replicas", "1") as one:
            _tell("cluster, 1 replica", one.url, seconds)
            _tell("plain service again", plain.url, seconds)
    with launch(cluster, "--replicas", "2") as two:
        _tell("cluster, 2 replicas", two.url, seconds)


def _tell(name: str, url: str, seconds: float) -> None:
    for kind, fields in KINDS.items():
        latency, rate = asyncio.run(_measure(url, BODY | fields, seconds))
        print(
            f"{kind}, {name}: {1e3 * latency:.2f} ms (median of {ONE_BY_ONE}), "
            f"{rate:.0f} plans/s over {CONNECTIONS} connections",
            flush=True,
        )


async def _measure(url: str, body: dict[str, Any], seconds: float) -> tuple[float, float]:
    """Return the median seconds of a plan alone, and plans a second over many connections."""
    async with httpx.AsyncClient(base_url=url, timeout=60) as client:

        async def ask(seed: int) -> float:
            began = perf_counter()
            (await client.post("/plan", json=body | {"seed": seed})).raise_for_status()
            return perf_counter() - began

        for seed in range(WARM_UP):
            await ask(seed)
        latency = statistics.median([await ask(seed) for seed in range(ONE_BY_ONE)])
        end, done = perf_counter() + seconds, 0

        async def go_on() -> None:
            nonlocal done
            while perf_counter() < end:
                await ask(done)
                done += 1

        async with asyncio.TaskGroup() as clients:
            for _ in range(CONNECTIONS):
                clients.create_task(go_on())
        return latency, done / seconds


if __name__ == "__main__":
    overhead()
