"""Figures are drawn from answers, in any format, and refuse answers that lack what they show."""

from pathlib import Path

import numpy as np
import pytest

from app.api.schemas import PlanRequest, PlanResponse
from app.api.service import PlanningService
from app.client.figures import draw_plan
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
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


def test_an_answer_without_candidates_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="candidates"):
        draw_plan(answer(["states"]), (0.2, 0.0), tmp_path / "plan.png")
    assert not np.any([path.exists() for path in tmp_path.iterdir()])
