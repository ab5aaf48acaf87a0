"""Figures are drawn from answers, in any format, and refuse answers that lack what they show."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from app.api.schemas import PlanRequest, PlanResponse
from app.api.service import PlanningService
from app.client.figures import draw_frontier, draw_plan
from app.client.sampler_frontier import SETTINGS, Point
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.planning.methods import ActionDiffusion
from app.settings import Settings


def answer(include: list[str]) -> PlanResponse:
    service = PlanningService(Settings(), ModelStore([]), Engine(1))
    request = {"initial_state": (0, 0), "target_state": (0.2, 0), "method": "dataset_prior"}
    return service.plan(PlanRequest.model_validate(request | {"include": include}))


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_a_plan_is_drawn(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"plan.{ending}"
    draw_plan(answer(["states", "candidates"]), (0.2, 0.0), path)
    assert path.stat().st_size > 1000


def evaluations(setting: ActionDiffusion) -> int:
    return setting.cost(1).network_evaluations


def frontier(settings: Sequence[ActionDiffusion]) -> list[Point]:
    return [
        Point(setting, k, k / evaluations(setting), (0.0, 0.0, 0.0))
        for k in (1, 16)
        for setting in settings
    ]


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_a_frontier_is_drawn(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"frontier.{ending}"
    draw_frontier(frontier(SETTINGS), path)
    assert path.stat().st_size > 1000


@pytest.mark.parametrize("settings", [SETTINGS, SETTINGS[:3]], ids=["all", "a handful"])
def test_a_frontier_shows_every_point_in_its_panel_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch, settings: Sequence[ActionDiffusion]
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    points = frontier(settings)

    draw_frontier(points, Path("nowhere.png"))

    for axes, k in zip(drawn[0].axes, (1, 16), strict=True):
        shown = [np.asarray(line.get_xydata()).tolist() for line in axes.lines]
        assert {tuple(xy) for line in shown for xy in line} == {
            (evaluations(point.setting), point.error)
            for point in points
            if point.num_candidates == k
        }


def test_an_unknown_format_of_a_frontier_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nope"):
        draw_frontier(frontier(SETTINGS), tmp_path / "frontier.nope")


def test_an_answer_without_candidates_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="candidates"):
        draw_plan(answer(["states"]), (0.2, 0.0), tmp_path / "plan.png")
    assert not np.any([path.exists() for path in tmp_path.iterdir()])
