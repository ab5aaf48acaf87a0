"""The frontier of samplers: paired with the paper's setting, and an honest report."""

from pathlib import Path

import httpx
import numpy as np
import pytest

from app.client import sampler_frontier
from app.client.planner_client import PlannerClient
from app.client.sampler_frontier import MARGIN, PAPER, SETTINGS, Point, measure, report
from app.planning.methods import ActionDiffusion
from app.settings import Settings
from tests.serving import serving, wait_until_ready

QUICK = ActionDiffusion(sampler="dpm_solver", steps=1, guidance_scale=1.0)


def test_the_setting_of_the_paper_comes_first_and_each_other_once() -> None:
    assert SETTINGS[0] == PAPER
    assert len({setting.settings for setting in SETTINGS}) == len(SETTINGS)


def test_what_a_service_does_by_default_is_among_the_settings() -> None:
    assert ActionDiffusion().settings in [setting.settings for setting in SETTINGS]


async def measured(model_store: Path) -> list[Point]:
    with serving(Settings(model_store=model_store)) as client:
        wait_until_ready(client)
        async with httpx.AsyncClient(base_url=client.base_url, timeout=60) as http:
            return [point async for point in measure(PlannerClient(http), (1, 4), 3, 2, seed=5)]


@pytest.mark.anyio
async def test_every_setting_is_compared_with_the_paper_s_at_the_same_budget(
    model_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sampler_frontier, "SETTINGS", (PAPER, QUICK))

    points = await measured(model_store)

    assert [(p.setting, p.num_candidates) for p in points] == [
        (PAPER, 1),
        (QUICK, 1),
        (PAPER, 4),
        (QUICK, 4),
    ]
    for paper, quick in (points[:2], points[2:]):
        assert paper.difference == (0.0, 0.0, 0.0)
        assert quick.difference[0] == pytest.approx(quick.error - paper.error)
        assert quick.difference[1] < quick.difference[0] < quick.difference[2]
    # The best of more candidates.
    assert points[2].error < points[0].error


def reported(*points: Point) -> list[str]:
    """The rows of the table, without its head."""
    return list(report(list(points)))[2:]


@pytest.mark.parametrize(
    ("high", "inferior"),
    [(0.0, False), (MARGIN, False), (float(np.nextafter(MARGIN, 1)), True), (0.5, True)],
)
def test_an_asterisk_marks_what_may_be_worse_by_more_than_the_margin(
    high: float, inferior: bool
) -> None:
    (row,) = reported(Point(QUICK, 16, 0.1234, (0.002, -0.001, high)))

    assert row.startswith("| `dpm_solver` | 1 | 1 | 1 | 0.123")
    assert f"(+0.002 [-0.001, {high:+.3f}])" in row
    assert ("*" in row) == inferior


def test_a_row_holds_all_budgets_and_the_setting_of_the_paper_is_compared_with_nothing() -> None:
    paper, quick = reported(
        Point(PAPER, 4, 0.2, (0.0, 0.0, 0.0)),
        Point(QUICK, 4, 0.3, (0.1, 0.1, 0.1)),
        Point(PAPER, 1, 0.4, (0.0, 0.0, 0.0)),
        Point(QUICK, 1, 0.5, (0.1, 0.0, 0.2)),
    )

    assert paper == "| `paper` | 50 | 2 | 100 | 0.400 | 0.200 |"
    assert quick == (
        "| `dpm_solver` | 1 | 1 | 1 "
        "| 0.500* (+0.100 [+0.000, +0.200]) | 0.300* (+0.100 [+0.100, +0.100]) |"
    )


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"
