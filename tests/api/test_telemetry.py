"""One log line and one count for each request, and an id that both sides know."""

import logging
import re
import socket
import threading
from collections.abc import Iterator
from time import perf_counter
from typing import Any

import httpx
import pytest
from fastapi import Request

from app.launch import START_SECONDS
from app.main import create_app
from app.settings import Settings
from tests.metrics import value
from tests.served import client_of, running, wait_until

PLANNED = {
    "method": "cem",
    "model": "tiny/1",
    "num_candidates": 16,
    "num_targets": 1,
    "seed": 7,
    "queue_ms": 250.0,
    "total_ms": 300.5,
}
WAITING = threading.Event()
"""Set once `/wait` waits for its client to hang up."""


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service without models that has a few routes more."""
    app = create_app(Settings(model_store=tmp_path_factory.mktemp("empty")))

    async def planned(request: Request) -> float:
        request.state.log_fields.update(PLANNED)
        return perf_counter() - float(request.state.arrived)

    async def refuse(request: Request) -> None:
        request.state.log_fields |= {"rejected": "queue_full", "model": "tiny/1"}

    async def fail() -> None:
        raise ZeroDivisionError

    async def wait(request: Request) -> None:
        WAITING.set()
        while (await request.receive())["type"] != "http.disconnect":
            pass

    app.add_api_route("/planned/{number}", planned)
    app.add_api_route("/refuse", refuse)
    app.add_api_route("/fail", fail)
    app.add_api_route("/wait", wait)
    with running(app) as url, client_of(url) as client:
        yield client


@pytest.fixture
def logged(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    """What is logged, requests too."""
    caplog.set_level(logging.INFO, "breakaway.access")
    return caplog


def access_line(logged: pytest.LogCaptureFixture, path: str) -> dict[str, Any]:
    """Return the fields of the one access line about `path`; it follows the answer."""
    found: list[dict[str, Any]] = []

    def is_there() -> bool:
        found[:] = [
            line.__dict__
            for line in logged.records
            if line.name == "breakaway.access" and line.__dict__["path"] == path
        ]
        return bool(found)

    wait_until(is_there)
    (only,) = found
    return only


def test_a_request_is_one_line_with_all_that_its_handler_knows(
    client: httpx.Client, logged: pytest.LogCaptureFixture
) -> None:
    began = perf_counter()
    answer = client.get("/planned/3", headers={"X-Request-ID": "asked-1"})
    assert 0 <= answer.json() <= perf_counter() - began
    line = access_line(logged, "/planned/3")
    assert 0 < line["duration_ms"] <= 1e3 * (perf_counter() - began)
    assert line["request_id"] == "asked-1"
    assert line["route"] == "/planned/{number}"
    assert line["http_method"] == "GET"
    assert line["status"] == 200
    assert line | PLANNED == line
    assert re.fullmatch(r"GET /planned/3 200 in [0-9.]+ ms", line["message"])


def test_method_and_model_label_the_metrics(client: httpx.Client) -> None:
    client.get("/planned/4")
    labels = {"route": "/planned/{number}", "method": "cem", "model": "tiny/1"}
    text = client.get("/metrics").text
    assert value(text, "breakaway_requests_total", **labels) >= 1
    assert value(text, "breakaway_request_duration_seconds_count", **labels) >= 1


def test_waiting_and_refusals_reach_the_metrics(client: httpx.Client) -> None:
    client.get("/planned/5")
    client.get("/refuse")
    text = client.get("/metrics").text
    waited = value(text, "breakaway_queue_seconds_sum", model="tiny/1")
    assert waited == 0.25 * value(text, "breakaway_queue_seconds_count", model="tiny/1") > 0
    assert value(text, "breakaway_rejected_total", reason="queue_full", model="tiny/1") == 1


@pytest.mark.parametrize("path", ["/livez", "/nope", "/plan", "/fail"])
def test_every_answer_has_the_id_that_was_sent(client: httpx.Client, path: str) -> None:
    for identity in ("a", "trace_1.2-3", "x" * 128):
        answer = client.get(path, headers={"X-Request-ID": identity})
        assert answer.headers.get_list("x-request-id") == [identity]


@pytest.mark.parametrize("identity", ["", "x" * 129, "two words", "a;b", "naïve"])
def test_an_id_of_another_form_is_replaced(client: httpx.Client, identity: str) -> None:
    headers = {b"X-Request-ID": identity.encode()}
    answers = [client.get("/livez", headers=headers) for _ in range(2)]
    fresh = {answer.headers["x-request-id"] for answer in answers}
    assert len(fresh) == 2
    assert all(re.fullmatch("[0-9a-f]{32}", identity) for identity in fresh)


def test_an_unexpected_error_is_answered_and_counted_as_500(
    client: httpx.Client, logged: pytest.LogCaptureFixture
) -> None:
    answer = client.get("/fail", headers={"X-Request-ID": "bad-luck"})
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert access_line(logged, "/fail")["status"] == 500
    text = client.get("/metrics").text
    assert value(text, "breakaway_requests_total", route="/fail", status="500") >= 1
    told = [
        line for line in logged.records if line.exc_info and line.exc_info[0] is ZeroDivisionError
    ]
    assert len(told) == 1


def test_a_client_that_hangs_up_is_counted_as_499(
    client: httpx.Client, logged: pytest.LogCaptureFixture
) -> None:
    with socket.create_connection((client.base_url.host, client.base_url.port)) as connection:
        connection.sendall(b"GET /wait HTTP/1.1\r\nHost: x\r\n\r\n")
        assert WAITING.wait(START_SECONDS)
    assert access_line(logged, "/wait")["status"] == 499
    text = client.get("/metrics").text
    assert value(text, "breakaway_requests_total", route="/wait", status="499") == 1


def test_a_line_break_in_a_path_stays_in_its_field(
    client: httpx.Client, logged: pytest.LogCaptureFixture
) -> None:
    client.get("/no%0Apath")
    assert access_line(logged, "/no\npath")["status"] == 404
