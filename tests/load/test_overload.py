import asyncio
from pathlib import Path

import pytest
from rich.console import Console

from app.launch import launch
from app.settings import SHIPPED_MODELS
from tests.load.overload import overload
from tests.load.verdict import Verdict

BUSY = 0.2
"""Cores that others may keep busy where times are to say something."""


def failures(verdict: Verdict, *, in_time: bool) -> list[str]:
    """Return what failed; of the times only if they count and were not disturbed."""
    times_count = in_time and verdict.cores_of_others <= BUSY
    return [
        check.name
        for check in verdict.checks
        if not check.passed and (times_count or not check.is_timing)
    ]


def overloaded(folder: Path, seconds: float, module: str = "app") -> Verdict:
    with (
        (folder / "server.log").open("wb") as log,
        launch(module, "serve", "--model-store", str(SHIPPED_MODELS), output=log) as server,
    ):
        verdict = asyncio.run(overload(server.url, seconds, factor=4, seed=0))
    verdict.print(Console(width=120))
    return verdict


@pytest.mark.slow
def test_a_service_is_asked_for_more_than_it_can_do_for_five_minutes(tmp_path: Path) -> None:
    assert failures(overloaded(tmp_path, 300), in_time=True) == []


@pytest.mark.slow
def test_a_leak_is_seen(tmp_path: Path) -> None:
    verdict = overloaded(tmp_path, 40, "tests.load.leaky_server")
    assert "resident memory grew" in failures(verdict, in_time=False)
