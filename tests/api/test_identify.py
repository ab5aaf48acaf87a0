"""Identification over HTTP: answers that plans take, refusals by field, and never a 500."""

import asyncio
import json
from typing import Any

import httpx
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.client import AsyncPlannerClient, IdentifyRequest, IdentifyResponse, PlannerClient
from app.evaluation.logs import Recording, record
from app.planning.plant.system import System
from tests.metrics import value

EXAMPLE: dict[str, Any] = IdentifyRequest.model_json_schema()["examples"][0]


def identify(client: httpx.Client, **fields: Any) -> httpx.Response:
    return client.post("/identify", json=EXAMPLE | fields)


def test_an_answer_is_what_plans_take(client: httpx.Client) -> None:
    response = identify(client, num_systems=8)
    assert response.status_code == 200, response.text
    answer = response.json()
    assert {parameter["name"] for parameter in answer["parameters"]} == {
        *("control_gain", "coulomb_friction", "static_friction", "viscous_damping", "bias")
    }
    assert answer["system"]["coulomb_friction"] == pytest.approx(0.6, abs=0.02)
    assert answer["system"]["control_gain"] == pytest.approx(1.0, abs=0.02)
    assert len(answer["systems"]) == 8
    assert answer["seed"] == EXAMPLE["seed"]
    assert "identify;dur=" in response.headers["Server-Timing"]

    plan = {
        "initial_state": [0, 0],
        "target_state": [0.2, 0],
        "method": "dataset_prior",
        "refine": True,
        "system": answer["system"],
        "uncertainty": {"systems": answer["systems"], "num_motions": 32},
    }
    planned = client.post("/plan", json=plan)
    assert planned.status_code == 200, planned.text
    assert planned.json()["robustness"]["num_systems"] == 8


@pytest.mark.parametrize("delay", [0, 3])
def test_predictions_lie_beside_what_was_measured(client: httpx.Client, delay: int) -> None:
    positions = np.array(EXAMPLE["positions"])
    late = np.concatenate([np.full(delay, positions[0]), positions[: positions.size - delay]])
    fields = {"positions": late.tolist(), "delay_steps": delay, "include": ["predictions"]}
    answer = identify(client, **fields).json()
    predictions = answer["predictions"]
    starts, predicted = np.array(predictions["first_samples"]), np.array(predictions["positions"])
    assert predicted.shape[1] == 1 + round(answer["fit"]["window_s"] / EXAMPLE["time_step"])
    samples = starts[:, np.newaxis] + np.arange(predicted.shape[1])
    errors = predicted - late[samples]
    assert np.sqrt(np.mean(errors[:, -1] ** 2)) == pytest.approx(answer["fit"]["end_error_rms"])
    assert np.abs(errors[:, 0]).max() < 1e-3


def test_the_same_request_gets_the_same_answer(client: httpx.Client) -> None:
    answers = [identify(client).json() for _ in range(2)]
    for answer in answers:
        answer.pop("timing_ms")
    assert answers[0] == answers[1]


def test_both_clients_ask_alike(client: httpx.Client) -> None:
    request = IdentifyRequest.model_validate(EXAMPLE)
    url = str(client.base_url)
    with PlannerClient(url) as planner:
        waited = planner.identify(request)

    async def ask() -> IdentifyResponse:
        async with AsyncPlannerClient(url) as asynchronous:
            return await asynchronous.identify(request)

    awaited = asyncio.run(ask())
    assert waited.system == awaited.system
    assert waited.parameters == awaited.parameters


def shifted(by: float) -> list[float]:
    positions = np.array(EXAMPLE["positions"])
    return [*positions[:40], *(positions[40:] + by)]


@pytest.mark.parametrize(
    ("fields", "pointer", "reason"),
    [
        ({"positions": EXAMPLE["positions"][:50]}, "/positions", "50 positions to 76 controls"),
        ({"positions": [0.5] * 77}, "/positions", "nothing moved"),
        ({"controls": [0.5] * 76}, "/controls", "0.5 throughout"),
        ({"positions": shifted(1.0)}, "/positions", "two logs in one"),
        ({"positions": [0.0, "1", *EXAMPLE["positions"][2:]]}, "/positions/1", "valid number"),
        ({"controls": [2e6, *EXAMPLE["controls"][1:]]}, "/controls/0", "less than or equal"),
        ({"controls": EXAMPLE["controls"][::-1]}, "/controls", "no plant of this kind"),
        ({"time_step": 0}, "/time_step", "greater than or equal"),
        ({"time_step": 20.0}, "/time_step", "are times in ms"),
        ({"known": {"control_limit": 0.5}}, "/known/control_limit", "the log holds a control of"),
        ({"delay_steps": 60}, "/delay_steps", "too few are left"),
        ({"known": {"control_gain": 0}}, "/known/control_gain", "greater than or equal"),
        ({"known": {"mass": 1}}, "/known/mass", "Extra inputs"),
        (
            {"known": {"static_friction": 1, "coulomb_friction": 2}},
            "/known",
            "coulomb_friction must not exceed static_friction",
        ),
        ({"known": {"bias": "no"}}, "/known/bias", "valid number"),
        ({"num_systems": 129}, "/num_systems", "less than or equal to 128"),
        ({"deadline_ms": 10_000_000}, "/deadline_ms", "at most"),
    ],
)
def test_what_cannot_be_is_refused_by_its_field(
    client: httpx.Client, fields: dict[str, Any], pointer: str, reason: str
) -> None:
    response = identify(client, **fields)
    assert response.status_code == 422, response.text
    (error,) = response.json()["errors"]
    assert error["pointer"] == pointer
    assert reason in error["detail"]


def test_a_nan_is_called_by_its_name(client: httpx.Client) -> None:
    text = json.dumps(EXAMPLE).replace("0.0007", "NaN", 1)
    response = client.post("/identify", content=text, headers={"Content-Type": "application/json"})
    assert response.status_code == 422
    assert response.json()["errors"] == [
        {"pointer": "/positions/1", "detail": "NaN is not a finite number"}
    ]


def test_a_long_log_is_taken_where_a_plan_of_its_size_is_not(client: httpx.Client) -> None:
    log = record(Recording(num_steps=2500), System(), 0, 0).model_dump()
    assert len(json.dumps(log)) > client.get("/info").json()["limits"]["max_body_bytes"]
    answer = client.post("/identify", json=log)
    assert answer.status_code == 200, answer.text
    assert answer.json()["system"]["coulomb_friction"] == pytest.approx(0.6, abs=0.01)
    assert client.post("/plan", json=log).status_code == 413


def test_what_cannot_be_in_time_is_refused_at_once(client: httpx.Client) -> None:
    before = value(client.get("/metrics").text, "breakaway_rejected_total", reason="deadline")
    response = identify(client, deadline_ms=1)
    assert response.status_code == 429
    after = value(client.get("/metrics").text, "breakaway_rejected_total", reason="deadline")
    assert after == before + 1


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
FRICTION = st.floats(0, 10) | st.fixed_dictionaries(
    {"forward": st.floats(0, 10), "backward": st.floats(0, 10)}
)


@given(
    st.fixed_dictionaries(
        {},
        optional={
            "time_step": st.floats(1e-6, 10) | NUMBERS,
            "controls": st.lists(st.floats(-10, 10), min_size=30, max_size=80),
            "positions": st.lists(st.floats(-1, 1) | NUMBERS, min_size=30, max_size=80)
            | st.just([1e-3 * p for p in EXAMPLE["positions"]])
            | st.just(np.random.default_rng(0).uniform(-1, 1, 77).cumsum().tolist()),
            "velocities": st.lists(st.floats(-1, 1), min_size=77, max_size=77),
            "known": st.fixed_dictionaries(
                {},
                optional={
                    "static_friction": FRICTION,
                    "coulomb_friction": FRICTION,
                    "viscous_damping": FRICTION,
                    "stribeck_velocity": st.floats(1e-6, 10),
                    "bias": st.floats(-10, 10),
                    "control_gain": st.floats(1e-6, 1e6),
                    "control_limit": st.floats(1e-6, 10),
                    "velocity_threshold": st.floats(1e-6, 10),
                },
            ),
            "direction_dependent": st.booleans() | st.just("auto"),
            "delay_steps": st.integers(0, 64) | st.just("auto"),
            "num_systems": st.integers(0, 200),
        },
    )
)
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
def test_whatever_is_sent_there_is_an_answer_or_a_reason(
    client: httpx.Client, fields: dict[str, Any]
) -> None:
    response = identify(client, **fields)
    assert response.status_code in (200, 422), response.text
    if response.status_code == 200:
        answer = response.json()
        for parameter in answer["parameters"]:
            low, high = parameter["interval"]
            assert low <= parameter["value"] <= high
    else:
        assert response.json()["errors"]
