"""Deadlines and hang-ups over HTTP: refused at once, dropped in time, and counted."""

import socket
from typing import Any

import httpx
import pytest

from tests.metrics import pending, value
from tests.served import wait_until

PLAN: dict[str, Any] = {"initial_state": [0, 0], "target_state": [0.5, 0], "seed": 1}
LONG = PLAN | {"method": {"name": "cem", "iterations": 1000}, "num_candidates": 4000}
"""Three seconds or more."""


def rejected(client: httpx.Client, reason: str) -> float:
    text = client.get("/metrics").text
    return value(text, "breakaway_rejected_total", reason=reason)


@pytest.mark.parametrize("method", ["action_diffusion", "cem"])
def test_what_cannot_be_in_time_is_refused_at_once(client: httpx.Client, method: str) -> None:
    before = rejected(client, "deadline")
    body = PLAN | {"method": method, "num_candidates": 512, "deadline_ms": 1}

    answer = client.post("/plan", json=body)

    assert answer.status_code == 429
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert int(answer.headers["Retry-After"]) >= 1
    assert "its deadline is in" in answer.json()["detail"]
    assert rejected(client, "deadline") == before + 1


def test_what_can_be_in_time_is_answered(client: httpx.Client) -> None:
    assert client.post("/plan", json=PLAN | {"deadline_ms": 60_000}).is_success


def test_a_deadline_beyond_the_services_own_is_refused_by_its_field(client: httpx.Client) -> None:
    most = client.get("/info").json()["limits"]["max_deadline_ms"]

    answer = client.post("/plan", json=PLAN | {"deadline_ms": most + 1})

    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == "/deadline_ms"
    assert str(most) in answer.json()["detail"]


@pytest.mark.parametrize(
    "body",
    [LONG, PLAN | {"num_candidates": 2000, "method": {"name": "action_diffusion", "steps": 50}}],
    ids=["compiled", "network"],
)
def test_the_work_of_a_client_that_hangs_up_is_dropped(
    client: httpx.Client, body: dict[str, Any]
) -> None:
    before = rejected(client, "client_gone")
    content = httpx.Request("POST", "http://service/plan", json=body).read()
    head = (
        "POST /plan HTTP/1.1\r\nHost: service\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(content)}\r\n\r\n"
    )
    with socket.create_connection((client.base_url.host, client.base_url.port or 80)) as hasty:
        hasty.sendall(head.encode() + content)
        wait_until(lambda: pending(client) > 0)

    wait_until(lambda: pending(client) == 0)
    assert rejected(client, "client_gone") == before + 1


def test_the_header_tells_the_same_times_as_the_body(client: httpx.Client) -> None:
    answer = client.post("/plan", json=PLAN)

    stages = [stage.split(";dur=") for stage in answer.headers["Server-Timing"].split(", ")]
    assert {name: float(ms) for name, ms in stages} == answer.json()["timing_ms"]
