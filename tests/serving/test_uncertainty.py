"""Uncertainty reaches a model that knows of it by itself, and the answer says what it was told."""

from collections.abc import Iterator
from typing import Any

import pytest

from app.inference.conditioning import Conditioning
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.serving.rates import Rates
from app.serving.service import PlanningService
from app.settings import Settings
from app.wire.requests import PlanRequest
from tests.inference.fakes import HORIZON, FakeNetwork, fake_model

FEATURES = ("initial_position", "coulomb_friction_spread", "target_position", "target_velocity")
CONDITION = Conditioning(features=FEATURES, mean=(0.0,) * 4, std=(1.0,) * 4)
MOST = {"coulomb_friction": 0.2}


@pytest.fixture
def network() -> FakeNetwork:
    return FakeNetwork()


@pytest.fixture
def service(network: FakeNetwork) -> Iterator[PlanningService]:
    engine = Engine(num_threads=1)
    knowing = fake_model(network, "knowing", condition=CONDITION, uncertainty=MOST)
    models = ModelStore([fake_model(FakeNetwork(), "a-nominal"), knowing])
    yield PlanningService(Settings(), models, engine, Rates())
    engine.close()


def request(**fields: Any) -> PlanRequest:
    body: dict[str, Any] = {
        "initial_state": [0, 0],
        "target_state": [0.1, 0],
        "method": "action_diffusion",
        "horizon": HORIZON,
        "seed": 3,
    }
    return PlanRequest.model_validate(body | fields)


def uncertain(**relative: float) -> dict[str, Any]:
    return {"uncertainty": {"relative": relative, "num_motions": 8}}


@pytest.mark.parametrize("refine", [False, True])
def test_the_model_is_told_by_how_much_the_plant_may_be_off(
    service: PlanningService, network: FakeNetwork, refine: bool
) -> None:
    answer = service.plan(
        service.resolve(request(**uncertain(coulomb_friction=0.1), refine=refine))
    )

    assert answer.model is not None
    assert answer.model.name == "knowing"
    assert [condition[1].item() for condition in network.embedded] == [pytest.approx(0.1)]
    assert answer.robustness is not None
    told = answer.robustness.told
    assert told is not None
    assert told.coulomb_friction == 0.1
    assert told.left_out is None


def test_of_what_it_does_not_know_it_is_told_the_nearest_and_the_answer_says_so(
    service: PlanningService, network: FakeNetwork
) -> None:
    answer = service.plan(
        service.resolve(request(**uncertain(coulomb_friction=0.4, control_gain=0.05)))
    )

    assert [condition[1].item() for condition in network.embedded] == [pytest.approx(0.2)]
    assert answer.robustness is not None
    assert answer.robustness.told is not None
    assert answer.robustness.told.left_out == [
        "coulomb_friction may be off by 40%, the model knows up to 20%",
        "control_gain may be off by 5%, the model knows up to 0%",
    ]


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"uncertainty": {"relative": {"coulomb_friction": 0.1}, "robust": False}},
        uncertain(coulomb_friction=0.1)
        | {"method": "cem", "initial": {"method": "action_diffusion"}},
    ],
)
def test_a_plan_for_the_plant_alone_has_the_first_model_and_nothing_is_told(
    service: PlanningService, network: FakeNetwork, fields: dict[str, Any]
) -> None:
    answer = service.plan(service.resolve(request(**fields)))

    assert answer.model is not None
    assert answer.model.name == "a-nominal"
    assert not network.embedded
    assert answer.robustness is None or answer.robustness.told is None


def test_a_model_that_knows_nothing_of_it_plans_for_the_plant_where_it_is_named(
    service: PlanningService,
) -> None:
    asked = request(**uncertain(coulomb_friction=0.1), model="a-nominal")
    answer = service.plan(service.resolve(asked))

    assert answer.robustness is not None
    assert answer.robustness.told is None


def test_a_descent_never_makes_a_robust_candidate_worse(service: PlanningService) -> None:
    proposed, refined = (
        service.plan(
            service.resolve(request(**uncertain(coulomb_friction=0.1), refine=refine))
        ).robustness
        for refine in (False, True)
    )

    assert proposed is not None
    assert refined is not None
    assert refined.mean_error < proposed.mean_error
