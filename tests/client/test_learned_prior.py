"""The learned prior against the dataset prior: paired tasks, every entrant, an honest report."""

import re
from pathlib import Path

import httpx
import numpy as np
import pytest

from app.client.learned_prior import (
    MEASURES,
    entrants,
    evaluate,
    report,
    tasks,
)
from app.client.planner_client import PlannerClient
from app.settings import Settings
from tests.serving import serving, wait_until_ready


def test_tasks_depend_on_the_seed_alone_and_cover_the_training_range() -> None:
    drawn = tasks(400, seed=0)
    assert drawn[:100] == tasks(100, seed=0)
    assert drawn != tasks(400, seed=1)
    starts = np.array([task["initial_state"] for task in drawn])
    targets = np.array([task["target_state"] for task in drawn])
    assert np.abs(starts[:, 0]).max() == pytest.approx(1, abs=0.02)
    assert np.abs(starts[:, 1]).max() == pytest.approx(0.5, abs=0.02)
    assert np.count_nonzero(targets[:, 1]) == 200


@pytest.mark.anyio
async def test_every_entrant_is_reported(model_store: Path) -> None:
    with serving(Settings(model_store=model_store)) as client:
        wait_until_ready(client)
        async with httpx.AsyncClient(base_url=client.base_url, timeout=60) as http:
            outcomes = [o async for o in evaluate(PlannerClient(http), num_tasks=4, seed=0)]
    assert [o.entrant for o in outcomes] == list(entrants())
    text = "\n".join(report(outcomes))
    for found in outcomes:
        row = rf"\| `{found.entrant.method}` \| {found.entrant.num_candidates} \|"
        assert re.search(row, text)
    assert text.count("[") == 9 * len(MEASURES)


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"
