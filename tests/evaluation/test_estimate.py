"""The estimate, with a service whose every part takes a known time on a clock of its own."""

import asyncio
from typing import Any

import httpx
import pytest

from app.client.planner_client import AsyncPlannerClient
from app.evaluation import estimate
from app.evaluation.estimate import Rates, measure_rates
from app.evaluation.question import Question
from app.evaluation.served import ServedModels
from app.planning.plant.system import System
from app.wire.requests import MultistepPlanRequest, PlanRequest
from tests.evaluation.fakes import answer_to, model_description

SERVED = ServedModels(System(), [model_description()])
TRUE = Rates(plan=0.01, network_row=1e-4, rollout=1e-5, refinement=0.5)


def seconds_of(rates: Rates, question: Question) -> float:
    return rates.seconds(question, SERVED.cost(question))


def measure(
    monkeypatch: pytest.MonkeyPatch, rates: Rates, *, network: bool = True
) -> tuple[Rates, list[PlanRequest]]:
    """Measure a service that takes as long as `rates` say, the first time ten times as long."""
    clock = [0.0]
    asked: list[PlanRequest] = []

    def handle(sent: httpx.Request) -> httpx.Response:
        request = PlanRequest.model_validate_json(sent.content)
        clock[0] += seconds_of(rates, Question({}, request)) * (1 if request in asked else 10)
        asked.append(request)
        return httpx.Response(200, text=answer_to(request).model_dump_json())

    async def run() -> Rates:
        transport = httpx.MockTransport(handle)
        async with AsyncPlannerClient("http://nowhere", transport=transport) as client:
            return await measure_rates(client, SERVED, network=network)

    monkeypatch.setattr(estimate, "perf_counter", lambda: clock[0])
    return asyncio.run(run()), asked


def test_the_rates_are_those_of_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = measure(monkeypatch, TRUE)
    for rate in Rates._fields:
        assert getattr(found, rate) == pytest.approx(getattr(TRUE, rate), rel=0.05)


def test_without_the_network_no_model_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    found, asked = measure(monkeypatch, TRUE, network=False)
    assert found.network_row == 0
    assert "action_diffusion" not in {request.method.name for request in asked}


def test_no_rate_is_negative(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = measure(monkeypatch, Rates(0.0, 0.0, -1e-6, -1e-3))
    assert min(found.network_row, found.rollout, found.refinement) >= 0


@pytest.mark.parametrize(
    ("fields", "seconds"),
    [
        ({"method": "uniform"}, 2 * 0.01 + 2 * 16e-5),
        ({"method": "uniform", "refine": True}, 2 * 0.51 + 2 * 16e-5),
        ({"method": "action_diffusion"}, 2 * 0.01 + 2 * 6 * 16e-4 + 2 * 16e-5),
        ({"method": "cem"}, 2 * 0.01 + 2 * 41 * 16e-5),
        (
            {"method": "cem", "initial": {"method": "action_diffusion"}},
            2 * 0.01 + 2 * 6 * 16e-4 + 2 * 41 * 16e-5,
        ),
    ],
)
def test_a_request_takes_the_sum_of_its_parts(fields: dict[str, Any], seconds: float) -> None:
    request = {"initial_state": (0.0, 0.0), "targets": [(0.2, 0.0), (0.0, 0.0)], **fields}
    question = Question({}, MultistepPlanRequest.model_validate(request))
    assert seconds_of(TRUE, question) == pytest.approx(seconds)
