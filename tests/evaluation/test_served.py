"""Which model of a service answers a question, and what that costs: as the service has it."""

from typing import Any

import pytest

from app.evaluation.answer_log import EvaluationError
from app.evaluation.question import Question
from app.evaluation.served import ServedModels
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Samplers, SamplerSettings
from app.planning.plant.coverage import Coverage
from app.planning.plant.system import System
from app.planning.problem import Cost
from app.wire.requests import MultistepPlanRequest, PlanRequest
from tests.evaluation.fakes import model_description

ONE_STEP = SamplerSettings(1, 1.0, first_time=1.0, last_time=0.0)
SERVED = ServedModels(
    System(),
    [
        model_description(
            "any",
            coverage=Coverage({"static_forward_over_limit": (0.02, 0.9)}),
            samplers=Samplers(ONE_STEP, ONE_STEP),
        ),
        model_description("paper", samplers=PAPER_MODEL_SAMPLERS),
    ],
)


def question(**fields: Any) -> Question:
    body = {"initial_state": (0, 0), "target_state": (0.2, 0), "method": "action_diffusion"}
    return Question({}, PlanRequest.model_validate(body | fields))


@pytest.mark.parametrize(
    ("fields", "evaluations"),
    [
        ({}, 1),
        ({"system": "emps"}, 1),
        ({"model": "paper"}, 6),
        ({"model": "paper/1"}, 6),
        ({"model": "any", "method": {"name": "action_diffusion", "sampler": "paper"}}, 100),
        ({"method": "cem", "initial": {"method": "action_diffusion"}}, 1),
        ({"method": "cem"}, 0),
    ],
)
def test_the_model_that_is_named_or_else_the_first_that_covers_says_what_a_plan_costs(
    fields: dict[str, Any], evaluations: int
) -> None:
    assert SERVED.can_answer(question(**fields))
    assert SERVED.cost(question(**fields)).network_evaluations == evaluations


def test_several_targets_cost_as_much_each_and_refinement_is_not_counted() -> None:
    body = {"initial_state": (0, 0), "targets": [(0.2, 0), (0.1, 0)], "num_candidates": 4}
    asked = MultistepPlanRequest.model_validate(body | {"model": "paper", "refine": True})

    assert SERVED.cost(Question({}, asked)) == Cost(12, 8)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"horizon": 32}, r"no model that was trained for System\("),
        ({"system": {"static_friction": 0.85}}, "static_friction=0.85"),
        ({"model": "nobody"}, "no model nobody"),
    ],
)
def test_where_there_is_no_model_that_is_said(fields: dict[str, Any], message: str) -> None:
    assert not SERVED.can_answer(question(**fields))
    with pytest.raises(EvaluationError, match=message):
        SERVED.cost(question(**fields))


@pytest.mark.parametrize(
    ("fields", "model", "otherwise"),
    [
        ({}, "any/1", False),
        ({}, "paper/1", True),
        ({}, None, True),
        ({"model": "paper"}, "paper/1", False),
        ({"model": "nobody"}, "nobody/1", False),
        ({"horizon": 32}, None, False),
        ({"method": "cem"}, None, False),
    ],
)
def test_an_answer_of_another_model_than_would_be_asked_now_is_told(
    fields: dict[str, Any], model: str | None, otherwise: bool
) -> None:
    assert SERVED.answers_otherwise(question(**fields), model) == otherwise
