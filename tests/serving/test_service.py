"""Which plant and model a request means."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from app.inference.engine import Engine
from app.inference.model_store import ModelStore, UnfitModel
from app.planning.methods import WarmStarted
from app.planning.methods.sampler import Sampler, Samplers, SamplerSettings
from app.planning.objectives import OBJECTIVES
from app.planning.plant.coverage import Coverage
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import System
from app.planning.problem import state_after
from app.serving.admission import MARGIN, MARGIN_SECONDS
from app.serving.json_parts import json_parts
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.serving.service import PlanningService
from app.settings import Settings
from app.wire.requests import MultistepPlanRequest, PlanRequest
from tests.inference.fakes import HORIZON, FakeNetwork, fake_model

NOMINAL = Coverage.only(System())
STIFF = Coverage(NOMINAL.ranges | {"static_forward": (1.0, 2.0), "static_backward": (1.0, 2.0)})
STIFF_SAMPLERS = Samplers(
    dpm_solver=SamplerSettings(2, 1.0, first_time=1.0, last_time=0.5),
    ddim=SamplerSettings(4, 3.0, first_time=1.0, last_time=0.0),
)


@pytest.fixture
def service() -> Iterator[PlanningService]:
    engine = Engine(num_threads=1)
    stiff = fake_model(
        FakeNetwork(),
        "stiff",
        coverage=STIFF,
        system=System(static_friction=1.5),
        samplers=STIFF_SAMPLERS,
    )
    models = [fake_model(FakeNetwork(), "nominal"), stiff]
    yield PlanningService(Settings(), ModelStore(models), engine, Rates())
    engine.close()


def request(**fields: object) -> PlanRequest:
    body = {"initial_state": [0, 0], "target_state": [0.2, 0], "method": "action_diffusion"}
    return PlanRequest.model_validate(body | fields)


def test_a_request_that_names_a_model_alone_is_for_the_model_s_own_plant(
    service: PlanningService,
) -> None:
    task = service.resolve(request(model="stiff"))

    assert task.system == System(static_friction=1.5)
    assert task.horizon == HORIZON
    assert service.resolve(request(model="nominal")).system == System()


@pytest.mark.parametrize("friction", [1.0, 1.7, 2.0])
def test_a_plant_within_the_range_of_a_model_is_planned_for_with_it(
    service: PlanningService, friction: float
) -> None:
    task = service.resolve(request(system={"static_friction": friction}, horizon=HORIZON))

    assert task.work.model is not None
    assert task.work.model.label == "stiff/1"
    assert task.system == System(static_friction=friction)


@pytest.mark.parametrize("fields", [{"system": {"static_friction": 2.1}}, {"horizon": 64}])
def test_what_the_named_model_does_not_cover_is_refused_with_what_it_covers(
    service: PlanningService, fields: dict[str, object]
) -> None:
    with pytest.raises(UnfitModel) as refusal:
        service.resolve(request(model="stiff", **fields))

    assert str(refusal.value) == (
        f"stiff/1 was trained for plants with {STIFF}, and horizon {HORIZON}"
    )


def test_a_plant_that_no_model_covers_is_refused_with_all_that_is_covered(
    service: PlanningService,
) -> None:
    with pytest.raises(UnfitModel) as refusal:
        service.resolve(request(system="emps", horizon=HORIZON))

    assert str(refusal.value) == (
        f"no model was trained for this plant and horizon {HORIZON} (other methods need none); "
        f"there are: nominal/1 for plants with {NOMINAL}, and horizon {HORIZON}; "
        f"stiff/1 for plants with {STIFF}, and horizon {HORIZON}"
    )


def test_pending_controls_lie_within_the_limits_of_the_plant_that_is_meant(
    service: PlanningService,
) -> None:
    controls = [10.0, -10.0, 10.1]
    asked = request(system="emps", method="cem", pending_controls=controls[:2])
    start = service.resolve(asked).problem((0.2, 0.0)).initial_state
    expected = state_after(controls[:2], np.zeros(2), MACHINES["emps"].system)
    np.testing.assert_array_equal(start, expected)
    with pytest.raises(InvalidField, match=r"10.1 is beyond the plant's limits, -10 to 10") as no:
        service.resolve(asked.model_copy(update={"pending_controls": controls}))
    assert no.value.pointer == "/pending_controls/2"


def test_pending_controls_are_no_work_worth_counting(service: PlanningService) -> None:
    idle, busy = (
        service.resolve(request(method="cem", pending_controls=pending)).work.rollout_steps
        for pending in ([], [0.9] * 1024)
    )
    assert idle == busy > 90 * 1024


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_the_first_refined_plan_of_the_usual_size_is_expected_within_fifty_milliseconds(
    service: PlanningService, objective: str
) -> None:
    work = service.resolve(request(method="dataset_prior", refine=True, objective=objective)).work

    seconds = Rates().seconds_of_steps(work.kind, work.rollout_steps)
    assert 0.001 < MARGIN * seconds + MARGIN_SECONDS < 0.05


@pytest.mark.parametrize("include", [["candidates"], ["states"], ["states", "candidates"]])
@pytest.mark.parametrize("kind", [PlanRequest, MultistepPlanRequest])
def test_how_long_an_answer_will_be_is_known_before(
    service: PlanningService, kind: type[PlanRequest | MultistepPlanRequest], include: list[str]
) -> None:
    state = [0.2, 0.0]
    targets = {"target_state": state} if kind is PlanRequest else {"targets": [state] * 3}
    body = {"initial_state": [0, 0], "method": "uniform", "horizon": 400, "include": include}
    asked: Any = kind.model_validate(body | targets)
    resolved = service.resolve(asked)

    text = b"".join(json_parts(service.answer(resolved)))

    assert resolved.work.answer_bytes == pytest.approx(len(text), rel=0.3)


@pytest.mark.parametrize(("guidance_scale", "rows"), [(0, 8), (1, 8), (0.5, 16), (2, 16)])
@pytest.mark.parametrize("is_initial", [False, True])
def test_as_many_rows_go_at_once_as_guidance_has_predictions_to_weigh(
    service: PlanningService, guidance_scale: float, rows: int, is_initial: bool
) -> None:
    method = {"name": "action_diffusion", "steps": 5, "guidance_scale": guidance_scale}
    fields = {"method": "cem", "initial": {"method": method}} if is_initial else {"method": method}
    work = service.resolve(request(model="stiff", num_candidates=8, **fields)).work

    assert work.rows_per_step == rows
    assert work.rows_left == 5 * rows


def test_plans_refined_for_another_objective_are_of_another_kind(service: PlanningService) -> None:
    def kind(**fields: object) -> str:
        return service.resolve(request(method="dataset_prior", **fields)).work.kind

    assert kind() == kind(objective="control_energy") == "dataset_prior"
    assert kind(refine=True) != kind(refine=True, objective="control_energy")


@pytest.mark.parametrize(
    ("fields", "settings", "rows"),
    [
        ({}, (2, 1.0, 1.0, 0.5), 2),
        ({"sampler": "ddim"}, (4, 3.0, 1.0, 0.0), 8),
        ({"steps": 3}, (3, 1.0, 1.0, 0.5), 3),
        ({"guidance_scale": 2.0}, (2, 2.0, 1.0, 0.5), 4),
        ({"sampler": "paper"}, (50, 2.0, 1.0, 0.0), 100),
    ],
)
@pytest.mark.parametrize("is_initial", [False, True])
def test_what_a_request_leaves_open_is_settled_by_the_model_that_it_is_for(
    service: PlanningService,
    fields: dict[str, Any],
    settings: tuple[int, float, float, float],
    rows: int,
    is_initial: bool,
) -> None:
    method = {"name": "action_diffusion", **fields}
    asked = {"method": "cem", "initial": {"method": method}} if is_initial else {"method": method}
    resolved = service.resolve(request(model="stiff", num_candidates=4, **asked))

    settled = resolved.recipe.method
    sampler = settled.initial if isinstance(settled, WarmStarted) else settled
    assert isinstance(sampler, Sampler)
    assert sampler.settings == SamplerSettings(*settings)
    assert resolved.work.rows_left == 4 * rows


def test_the_answer_says_the_cost_of_the_model_s_own_sampler(service: PlanningService) -> None:
    network_evaluations = {
        name: service.plan(service.resolve(request(model=name))).cost.network_evaluations
        for name in ("nominal", "stiff")
    }
    assert network_evaluations == {"nominal": 6, "stiff": 2}


def test_the_limit_on_rows_is_that_of_the_model_s_own_sampler(service: PlanningService) -> None:
    settings = Settings(max_network_rows=40)
    small = PlanningService(settings, service.models, None, Rates())

    assert small.resolve(request(model="stiff", num_candidates=20)).work.rows_left == 40
    with pytest.raises(InvalidField, match="48 rows through the network"):
        small.resolve(request(model="nominal", num_candidates=8))


def test_what_is_too_large_for_any_model_is_refused_for_its_size(service: PlanningService) -> None:
    with pytest.raises(InvalidField, match="time steps"):
        service.resolve(request(horizon=100_000))
