"""A plan is drawn from its answer, in any format; candidates are rolled out for the picture."""

from pathlib import Path

import numpy as np
import pytest

from app.figures.plan import draw_plan
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.serving.rates import Rates
from app.serving.service import PlanningService
from app.settings import Settings
from app.wire.answers import PlanResponse
from app.wire.requests import PlanRequest

REQUEST = PlanRequest.model_validate(
    {
        "initial_state": (0.1, -0.2),
        "target_state": (0.2, 0.0),
        "method": "dataset_prior",
        "seed": 7,
        "include": ["states", "candidates"],
    }
)


def answer() -> PlanResponse:
    service = PlanningService(Settings(), ModelStore([]), Engine(1), Rates())
    return service.plan(service.resolve(REQUEST))


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_a_plan_is_drawn(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"plan.{ending}"
    draw_plan(REQUEST, answer()).savefig(path)
    assert path.stat().st_size > 1000


def test_what_is_drawn_are_the_answer_s_own_trajectories() -> None:
    plan = answer()
    assert plan.candidates is not None
    without_states = plan.model_copy(
        update={"states": None, "candidates": plan.candidates.model_copy(update={"states": None})}
    )

    controls, *state_panels = draw_plan(REQUEST, without_states).axes

    times = plan.system.time_step * np.arange(65)
    for number, line in enumerate(controls.lines[:16]):
        own = plan.candidates.controls[number]
        np.testing.assert_array_equal(line.get_xydata(), np.c_[times, [*own, own[-1]]])
    np.testing.assert_array_equal(
        controls.lines[16].get_ydata(), [*plan.controls, plan.controls[-1]]
    )
    for index, axes in enumerate(state_panels):
        drawn = np.array([line.get_ydata() for line in axes.lines[:17]])
        np.testing.assert_array_equal(drawn[:16], np.array(plan.candidates.states)[:, :, index])
        np.testing.assert_array_equal(drawn[16], np.array(plan.states)[:, index])


def test_an_answer_without_candidates_is_refused() -> None:
    with pytest.raises(ValueError, match="candidates"):
        draw_plan(REQUEST, answer().model_copy(update={"candidates": None}))
