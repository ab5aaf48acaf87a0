"""The random multi-step protocol: the same tasks for every method, asked over HTTP."""

from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from app.api.schemas import MultistepPlanRequest
from app.client.multistep_random import Result, evaluate, random_sequences
from app.client.planner_client import PlannerClient
from app.settings import Settings
from tests.serving import serving, wait_until_ready


def test_sequences_depend_on_the_seed_alone() -> None:
    sequences = random_sequences(30, seed=0)
    assert sequences == random_sequences(30, seed=0)
    assert sequences[:10] == random_sequences(10, seed=0)
    assert sequences != random_sequences(30, seed=1)
    positions = np.array(sequences)[:, :, 0]
    assert positions.shape == (30, 3)
    assert np.abs(positions).max() <= 1
    assert np.array(sequences)[:, :, 1].any() == 0


async def collect(
    url: str, methods: dict[str, str | dict[str, Any]], budgets: list[int]
) -> list[Result]:
    async with httpx.AsyncClient(base_url=url, timeout=60) as http:
        client = PlannerClient(http)
        return [result async for result in evaluate(client, methods, budgets, 3, 2, seed=5)]


@pytest.mark.anyio
async def test_results_over_http_are_those_of_every_sequence_and_run(model_store: Path) -> None:
    with serving(Settings(model_store=model_store)) as client:
        wait_until_ready(client)
        url = str(client.base_url)
        results = await collect(
            url, {"uniform": "uniform", "prior": {"name": "dataset_prior"}}, [2, 64]
        )
        again = await collect(url, {"again": "dataset_prior"}, [64])
    assert [(r.label, r.method, r.num_candidates) for r in results] == [
        ("uniform", "uniform", 2),
        ("uniform", "uniform", 64),
        ("prior", "dataset_prior", 2),
        ("prior", "dataset_prior", 64),
    ]
    for result in results:
        assert result.mean_end_errors.shape == (6,)
        assert len(set(result.mean_end_errors)) > 1
    np.testing.assert_array_equal(results[3].mean_end_errors, again[0].mean_end_errors)
    assert results[3].mean_end_errors.mean() < results[2].mean_end_errors.mean()


@pytest.mark.anyio
async def test_every_method_gets_the_same_tasks_and_seeds() -> None:
    asked: dict[str, list[tuple[object, ...]]] = {}

    def answer(request: httpx.Request) -> httpx.Response:
        plan = MultistepPlanRequest.model_validate_json(request.content)
        key = f"{plan.method.name} {plan.num_candidates}"
        asked.setdefault(key, []).append((plan.initial_state, tuple(plan.targets), plan.seed))
        return httpx.Response(422, json={"detail": "enough"})

    async with httpx.AsyncClient(
        base_url="http://nowhere", transport=httpx.MockTransport(answer)
    ) as http:
        client = PlannerClient(http)
        for method in ("cem", "uniform"):
            with pytest.raises(httpx.HTTPStatusError):
                async for _ in evaluate(client, {method: method}, [16], 4, 2, seed=5):
                    pass
    assert asked["cem 16"]
    assert asked["cem 16"][0] == asked["uniform 16"][0]


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"
