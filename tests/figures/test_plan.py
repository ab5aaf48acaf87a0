"""A plan is drawn from its answer, in any format; candidates are rolled out for the picture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from app.figures.plan import draw_plan, draw_stiction_band
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.planning.plant.system import ByDirection, ControlLimits, System
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


def test_the_picture_begins_where_the_pending_controls_lead_to() -> None:
    request = REQUEST.model_copy(update={"pending_controls": [0.9, 0.9, -0.9]})
    service = PlanningService(Settings(), ModelStore([]), Engine(1), Rates())
    plan = service.plan(service.resolve(request))
    assert plan.states is not None
    _, positions, velocities = draw_plan(request, plan).axes
    for axes, values in ((positions, 0), (velocities, 1)):
        drawn = np.array([line.get_ydata() for line in axes.lines[:17]])
        assert set(drawn[:, 0]) == {plan.states[0][values]}
        np.testing.assert_array_equal(drawn[16], np.array(plan.states)[:, values])


@pytest.mark.parametrize(("gain", "unit"), [(1.0, "m/s²"), (0.5, "units of control")])
def test_controls_have_the_unit_of_their_plant(gain: float, unit: str) -> None:
    plan = answer()
    plan = plan.model_copy(update={"system": replace(plan.system, control_gain=gain)})
    assert draw_plan(REQUEST, plan).axes[0].get_ylabel() == f"control ({unit})"


def test_the_stiction_band_holds_the_controls_that_leave_a_mass_at_rest() -> None:
    system = System(
        static_friction=ByDirection(0.7, 1.2), bias=0.3, control_gain=0.5,
        control_limit=ControlLimits(-4, 6),
    )  # fmt: skip
    axes = Figure().subplots()
    draw_stiction_band(axes, system)
    (band,) = axes.patches
    assert isinstance(band, Rectangle)
    assert (band.get_y(), band.get_y() + band.get_height()) == pytest.approx((-3.0, 0.8))
    assert axes.get_ylim() == pytest.approx((-4.5, 6.5))


def test_an_answer_without_candidates_is_refused() -> None:
    with pytest.raises(ValueError, match="candidates"):
        draw_plan(REQUEST, answer().model_copy(update={"candidates": None}))
