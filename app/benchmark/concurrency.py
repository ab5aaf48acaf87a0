"""Many requests at once: small ones beside large ones, and all as fast as they can."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from statistics import median
from time import perf_counter
from typing import Any

import httpx

from app.launch import launch

SMALL, LARGE = 16, 512
"""K of the requests."""
SMALL_REQUESTS = 60
LARGE_CLIENTS = 2
CLIENTS = 16
REQUESTS_EACH = 16


def concurrency() -> Iterator[str]:
    """Ask our service and a first-come-first-served one the same; yield a Markdown list."""
    with (
        _serving("app", "serve") as ours,
        _serving("app.benchmark.first_come_baseline") as baseline,
    ):
        for client in (ours, baseline):
            _small_ones(client)
        idle = _small_ones(ours)
        yield f"- K = {SMALL} on an idle service: {idle:.1f} ms (median of {SMALL_REQUESTS})"
        for name, client in (("shared ticks", ours), ("first come, first served", baseline)):
            with _large_ones(client):
                latency = _small_ones(client)
            yield (
                f"- the same beside {LARGE_CLIENTS} clients with K = {LARGE} without a pause, "
                f"{name}: {latency:.1f} ms, {latency / idle:.1f} times that"
            )
        alone, together = _throughput(ours, 1), _throughput(ours, CLIENTS)
        yield (
            f"- K = {SMALL}: {alone:.0f} plans/s one after the other, {together:.0f} plans/s by "
            f"{CLIENTS} clients at once, ratio {together / alone:.2f}"
        )


@contextmanager
def _serving(*arguments: str) -> Iterator[httpx.Client]:
    """Run a service; yield a client of it."""
    with (
        launch(*arguments, "--log-level", "error") as server,
        httpx.Client(base_url=server.url, timeout=60) as client,
    ):
        yield client


def _body(num_candidates: int, seed: int) -> dict[str, Any]:
    return {
        "initial_state": [0.0, 0.0],
        "target_state": [0.5, 0.0],
        "num_candidates": num_candidates,
        "seed": seed,
        "include": [],
    }


def _ask(client: httpx.Client, num_candidates: int, seed: int) -> float:
    """Return how long the answer took, ms."""
    started = perf_counter()
    client.post("/plan", json=_body(num_candidates, seed)).raise_for_status()
    return (perf_counter() - started) * 1e3


def _small_ones(client: httpx.Client) -> float:
    return median(_ask(client, SMALL, seed) for seed in range(SMALL_REQUESTS))


@contextmanager
def _large_ones(client: httpx.Client) -> Iterator[None]:
    """Keep large requests under way until the context ends."""
    ending, begun = threading.Event(), threading.Barrier(LARGE_CLIENTS + 1)

    def ask() -> None:
        begun.wait()
        for seed in count():
            if ending.is_set():
                return
            _ask(client, LARGE, seed)

    with ThreadPoolExecutor(LARGE_CLIENTS) as threads:
        asking = [threads.submit(ask) for _ in range(LARGE_CLIENTS)]
        begun.wait()
        try:
            yield
        finally:
            ending.set()
        for client_ in asking:
            client_.result()


def _throughput(client: httpx.Client, num_clients: int) -> float:
    """Return plans per second."""
    requests = CLIENTS * REQUESTS_EACH
    with ThreadPoolExecutor(num_clients) as threads:
        started = perf_counter()
        for _ in threads.map(lambda seed: _ask(client, SMALL, seed), range(requests)):
            pass
        return requests / (perf_counter() - started)
