"""Expectations and upgrades: which are met, which are passed over, which are refused."""

import logging

import httpx
import pytest

from tests.api.test_errors import assert_problem

UNIFORM = {
    "initial_state": [0.0, 0.0],
    "target_state": [0.2, 0.0],
    "method": "uniform",
    "num_candidates": 1,
}
WEBSOCKET = {
    "Connection": "keep-alive, Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.mark.parametrize("expected", ["200-ok", "100-continue, 200-ok", "nothing=1"])
def test_an_unknown_expectation_is_refused(client: httpx.Client, expected: str) -> None:
    answer = client.post("/plan", json=UNIFORM, headers={"Expect": expected})
    problem = assert_problem(answer, 417)
    assert expected.rpartition(" ")[2] in problem["detail"]
    assert answer.headers["x-request-id"]
    assert answer.headers["connection"] == "close"


@pytest.mark.parametrize("expected", ["100-continue", "100-Continue", ""])
def test_a_known_one_is_met(client: httpx.Client, expected: str) -> None:
    answer = client.post("/plan", json=UNIFORM, headers={"Expect": expected})
    assert answer.status_code == 200


@pytest.mark.parametrize("client", ["process"], indirect=True)  # Serve's proxy has its own way
@pytest.mark.parametrize("path", ["/livez", "/nope", "/plan"])
def test_a_websocket_is_refused_and_nobody_is_advised_to_install_something(
    client: httpx.Client, caplog: pytest.LogCaptureFixture, path: str
) -> None:
    caplog.set_level(logging.DEBUG)
    problem = assert_problem(client.get(path, headers=WEBSOCKET), 400)
    assert problem["type"] == "urn:breakaway:problem:no-websocket"
    ours = [line for line in caplog.records if line.name.startswith(("uvicorn", "app"))]
    assert not [line for line in ours if line.levelno > logging.INFO]


@pytest.mark.parametrize("client", ["process"], indirect=True)  # Serve's proxy refuses them
def test_other_upgrades_are_passed_over_in_silence(
    client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    offer = {"Connection": "Upgrade, HTTP2-Settings", "Upgrade": "h2c", "HTTP2-Settings": "AA"}
    assert client.post("/plan", json=UNIFORM, headers=offer).status_code == 200
    assert not [line for line in caplog.records if line.levelno > logging.INFO]
