"""Measures are read from what the service really answers."""

from typing import Any

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.measures import OF_A_PLAN, OF_A_SEQUENCE, measures
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.serving.rates import Rates
from app.serving.service import PlanningService
from app.settings import Settings
from app.wire.requests import MultistepPlanRequest, PlanRequest

REQUEST: dict[str, Any] = {
    "initial_state": (0, 0),
    "method": "dataset_prior",
    "num_candidates": 4,
    "seed": 5,
    "include": [],
}


@pytest.fixture(scope="module")
def service() -> PlanningService:
    return PlanningService(Settings(), ModelStore([]), Engine(1), Rates())


def test_a_plan_s_measures(service: PlanningService) -> None:
    request = PlanRequest.model_validate(REQUEST | {"target_state": (9, 0)})
    answer = service.plan(service.resolve(request))

    row = measures(Answer(answer.model_dump(mode="json", exclude_none=True), latency_ms=12.5))

    assert {name: row[name] for name in OF_A_PLAN} == {
        name: getattr(answer, name) for name in OF_A_PLAN
    }
    assert answer.reachability is not None
    assert row["floor"] == answer.reachability.floor > 0
    assert not row["reachable"]
    assert row["gap"] == pytest.approx(row["terminal_error"] - row["floor"])
    assert (row["seed"], row["rollouts"], row["network_evaluations"]) == (5, 4, 0)
    assert row["stuck_steps"] == answer.stuck_steps
    assert row["diversity"] == answer.diversity > 0
    assert row["latency_ms"] == 12.5
    timing = answer.timing_ms
    assert row["compute_ms"] == pytest.approx(timing.total - timing.queue, abs=0.002)


def test_a_sequence_s_measures_are_of_all_its_plans(service: PlanningService) -> None:
    targets = [(0.4, 0), (-0.2, 0)]
    request = MultistepPlanRequest.model_validate(REQUEST | {"targets": targets})
    answer = service.plan_multistep(service.resolve(request))

    row = measures(Answer(answer.model_dump(mode="json", exclude_none=True), latency_ms=12.5))

    assert {name: row[name] for name in OF_A_SEQUENCE} == {
        name: getattr(answer, name) for name in OF_A_SEQUENCE
    }
    assert row["control_energy"] == sum(part.control_energy for part in answer.segments)
    assert (row["seed"], row["rollouts"], row["network_evaluations"]) == (5, 8, 0)
    assert row["stuck_steps"] == sum(part.stuck_steps for part in answer.segments)
    assert row["diversity"] == pytest.approx(np.mean([part.diversity for part in answer.segments]))
    assert answer.mean_end_floor is not None
    assert row["mean_end_gap"] == answer.mean_end_error - answer.mean_end_floor
    assert "gap" not in row


def test_answers_from_before_there_was_a_diversity_have_none(service: PlanningService) -> None:
    request = PlanRequest.model_validate(REQUEST | {"target_state": (9, 0)})
    content = service.plan(service.resolve(request)).model_dump(mode="json", exclude={"diversity"})

    assert np.isnan(measures(Answer(content, latency_ms=1.0))["diversity"])


def test_waiting_in_the_service_s_queue_is_not_its_own_time() -> None:
    answer = Answer({"timing_ms": {"queue": 7.5, "total": 10.0}}, latency_ms=11.0)
    assert answer.compute_ms == 2.5
