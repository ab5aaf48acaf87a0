"""Many problems in one request, beside the same problems one `/plan` after the other."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from app.benchmark.pairing import paired
from app.client import BatchProblem, PlanBatchRequest, PlannerClient, PlanRequest
from app.launch import launch

SINGLE, MANY = 100, 1000
"""Problems that are asked for one by one, and in a batch."""
PAIRS = 5
CLIENTS = 16
REFINED: dict[str, Any] = {"method": "dataset_prior", "refine": True}
CASES: dict[str, dict[str, Any]] = {
    "dataset_prior, refined, without the floor": REFINED | {"reachability": False},
    "dataset_prior, refined": REFINED,
    "cem": {"method": "cem"},
    "cem without the floor": {"method": "cem", "reachability": False},
    "action_diffusion": {},
}


def batches() -> Iterator[str]:
    """Ask a service for plans, one by one, in a batch and by several clients; yield a list."""
    with (
        launch("app", "serve", "--log-level", "error") as server,
        PlannerClient(server.url) as client,
    ):
        for name, fields in CASES.items():
            one_by_one, in_batches = (
                partial(_single, client, fields),
                partial(_many, client, fields),
            )
            single_ms, batch_ms = paired(one_by_one, in_batches, PAIRS)
            alone, together = 1e3 * SINGLE / single_ms, 1e3 * MANY / batch_ms
            yield (
                f"- {name}, K = 16: {alone:.0f} plans/s one after the other, "
                f"{together:.0f} plans/s in a batch of {MANY}, ratio {together / alone:.1f}"
            )
        at_once = median(_by_clients(server.url, CASES["action_diffusion"]) for _ in range(PAIRS))
        yield (
            f"- action_diffusion, K = 16: {at_once:.0f} plans/s by {CLIENTS} clients at once, "
            f"ratio of the batch {together / at_once:.2f}"
        )


def _targets(count: int) -> list[float]:
    return [float(target) for target in np.random.default_rng(0).uniform(-1.0, 1.0, count)]


def _single(client: PlannerClient, fields: dict[str, Any]) -> None:
    for seed, target in enumerate(_targets(SINGLE)):
        client.plan(_request(fields, seed, target))


def _request(fields: dict[str, Any], seed: int, target: float) -> PlanRequest:
    task = {"initial_state": (0.0, 0.0), "target_state": (target, 0.0), "seed": seed}
    return PlanRequest.model_validate({**task, "include": [], **fields})


def _many(client: PlannerClient, fields: dict[str, Any]) -> None:
    problems = [
        BatchProblem(initial_state=(0.0, 0.0), target_state=(target, 0.0), seed=seed)
        for seed, target in enumerate(_targets(MANY))
    ]
    request = PlanBatchRequest.model_validate({"problems": problems, "include": [], **fields})
    answered = sum(1 for _ in client.plan_many(request))
    assert answered == MANY


def _by_clients(url: str, fields: dict[str, Any]) -> float:
    """Return plans per second."""

    def ask(number: int) -> None:
        with PlannerClient(url) as client:
            for seed, target in enumerate(_targets(SINGLE)[number::CLIENTS]):
                client.plan(_request(fields, seed, target))

    with ThreadPoolExecutor(CLIENTS) as threads:
        started = perf_counter()
        for _ in threads.map(ask, range(CLIENTS)):
            pass
        return SINGLE / (perf_counter() - started)
