"""Sessions over a WebSocket: their messages, their limits, their end, and what is told of them."""

import json
import logging
import socket
from base64 import urlsafe_b64encode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus

from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.settings import Settings
from tests.api.sessions import Session, opened, socket_url
from tests.metrics import value
from tests.served import serving, wait_until, wait_until_ready

KEY = "a-key-that-is-long-enough"
START = {"type": "start", "target_state": [0.2, 0.0], "steps_left": 40}
REST = {"type": "measure", "position": 0.0, "velocity": 0.0}
IDLE_S = 0.5


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service that needs a key, has room for two sessions, and little patience."""
    settings = Settings(
        model_store=tmp_path_factory.mktemp("empty"),
        api_keys=KEY,
        public_paths=("/livez", "/readyz", "/metrics"),
        max_sessions=2,
        max_body_bytes=2000,
        session_idle_timeout_s=IDLE_S,
        cors_origins=("https://good.example",),
    )
    with serving(settings) as client:
        wait_until_ready(client)
        yield client


BEARER = {"Authorization": f"Bearer {KEY}"}


def drive(session: Session, state: list[float], steps: int, truth: System) -> dict[str, Any]:
    """Control a simulated machine; `state` is where it is, before and after. Return the last."""
    told: dict[str, Any] = {}
    for _ in range(steps):
        told = session.ask({"type": "measure", "position": state[0], "velocity": state[1]})
        controls = [[told["control"]]]
        state[:] = rollout(truth, state, controls)[0, -1].tolist()  # type: ignore[arg-type]
    return told


def test_a_machine_arrives_and_goes_on_to_another_target_while_it_moves(
    client: httpx.Client,
) -> None:
    truth, state = System(0.78, 0.66), [0.0, 0.0]
    with opened(client) as session:
        started = session.ask(START)
        assert started["type"] == "started"
        assert started["deadline_ms"] == 50.0
        told = drive(session, state, 10, truth)
        assert (told["type"], told["step"], told["status"]) == ("control", 9, "moving")
        assert abs(state[1]) > 0.01
        target = {"type": "target", "target_state": [-0.1, 0.0]}
        assert session.ask(target) == {"type": "targeted", "step": 10}
        told = drive(session, state, 90, truth)
        assert told["status"] == "arrived"
        assert state[0] == pytest.approx(-0.1, abs=1e-3)
        ended = session.ask({"type": "stop"})
        assert (ended["type"], ended["reason"], ended["step"]) == ("ended", "stopped", 100)
        assert session.closed() == (1000, "stopped")


def test_another_target_is_planned_for_at_once_however_long_plans_are_followed(
    client: httpx.Client,
) -> None:
    controller = {"name": "receding_horizon", "replan_every": 64}
    with opened(client) as session:
        session.ask(START | {"controller": controller, "include": ["plan"]})
        assert session.ask(REST)["control"] > 0.7
        session.ask({"type": "target", "target_state": [-0.2, 0.0]})
        assert session.ask(REST)["control"] < -0.7


def test_a_session_goes_on_elsewhere_where_it_ended(client: httpx.Client) -> None:
    whole, half = [0.0, 0.0], [0.0, 0.0]
    truth = System(0.78, 0.66)
    with opened(client) as session:
        session.ask(START)
        drive(session, whole, 40, truth)
    with opened(client) as session:
        session.ask(START)
        drive(session, half, 13, truth)
        ended = session.ask({"type": "stop"})
    assert ended["steps_left"] == 27
    with opened(client) as session:
        left = {key: ended[key] for key in ("target_state", "steps_left")}
        session.ask(START | left | {"resume": ended["carry"]})
        drive(session, half, 27, truth)
    assert half == whole


@pytest.mark.parametrize(
    ("message", "status"),
    [
        ("{", 400),
        ("", 400),
        (b"\xff", 400),
        ("[" * 1000, 400),
        ("[1]", 422),
        ("null", 422),
        ('{"type": "measure", "type": "stop"}', 422),
        ({}, 422),
        ({"type": "begin"}, 422),
        ({"type": "measure"}, 422),
        ({"type": "measure", "position": "0"}, 422),
        ({"type": "measure", "position": float("nan")}, 422),
        ({"type": "measure", "position": 0.0, "speed": 1.0}, 422),
        ({"type": "measure", "position": 0.0, "velocity": 0.0, "step": 5}, 409),
        ({"type": "target", "target_state": [0.1, 1.0]}, 422),
        (START, 409),
    ],
)
def test_a_message_at_fault_is_a_problem_and_the_session_goes_on(
    client: httpx.Client, message: Any, status: int
) -> None:
    with opened(client) as session:
        session.ask(START)
        before = session.ask(REST)
        told = session.ask(message)
        assert (told["type"], told["status"]) == ("error", status)
        assert told["title"]
        assert told["detail"]
        assert told["instance"] == "/control"
        assert told["problem"].startswith("urn:breakaway:problem:")
        after = session.ask(REST | {"step": 1})
        assert (after["type"], after["step"]) == ("control", before["step"] + 1)


@pytest.mark.parametrize("message", [REST, {"type": "target", "target_state": [0.1, 0.0]}])
def test_what_comes_before_the_start_is_out_of_order(
    client: httpx.Client, message: dict[str, Any]
) -> None:
    with opened(client) as session:
        told = session.ask(message)
        assert told["problem"] == "urn:breakaway:problem:out-of-order"
        bad = session.ask(START | {"resume": {"version": 2}})
        assert bad["errors"][0]["pointer"] == "/resume/plan"
        assert session.ask(START)["type"] == "started"


def test_without_an_observer_a_velocity_is_needed(client: httpx.Client) -> None:
    with opened(client) as session:
        session.ask(START | {"controller": {"name": "pd", "observer": None}})
        told = session.ask({"type": "measure", "position": 0.0})
        assert told["errors"][0]["pointer"] == "/velocity"
        assert session.ask(REST)["type"] == "control"


@given(st.lists(st.binary(max_size=30) | st.text(max_size=30), max_size=4))
@settings(max_examples=25)
def test_whatever_is_said_gets_an_answer(client: httpx.Client, said: list[Any]) -> None:
    with opened(client) as session:
        session.ask(START)
        for message in said:
            assert session.ask(message)["type"] == "error"
        assert session.ask(REST)["type"] == "control"


def test_a_step_that_comes_too_late_says_so_and_is_counted(client: httpx.Client) -> None:
    def late() -> float:
        return value(client.get("/metrics").text, "breakaway_control_late_steps_total")

    before = late()
    with opened(client) as session:
        session.ask(START | {"deadline_ms": 1e-6})
        told = session.ask(REST)
        assert told["late"]
        assert told["timing_ms"]["total"] > 1e-6
        assert session.ask({"type": "stop"})["late_steps"] == 1
    assert late() == before + 1


def test_what_comes_with_a_control_is_asked_for(client: httpx.Client) -> None:
    with opened(client) as session:
        session.ask(START | {"include": ["plan", "carry"]})
        told = session.ask(REST)
        assert told["plan"][0] == told["control"]
        assert told["carry"]["version"] == 2
        assert "estimate" not in told


def refused(client: httpx.Client, **how: Any) -> tuple[int, dict[str, Any], Any]:
    """Return the status, the problem and the headers of a handshake that is refused."""
    with pytest.raises(InvalidStatus) as caught, opened(client, **how):
        pass
    response = caught.value.response
    assert response.headers["Content-Type"] == "application/problem+json"
    assert response.headers["X-Request-ID"]
    assert response.body is not None
    return response.status_code, json.loads(response.body), response.headers


def test_a_session_needs_a_key(small: httpx.Client) -> None:
    for headers in ({}, {"Authorization": "Bearer another-key-0123456789"}):
        status, problem, told = refused(small, headers=headers)
        assert (status, problem["status"]) == (401, 401)
        assert told["WWW-Authenticate"] == "Bearer"


def as_protocols(key: str) -> list[str]:
    """Return what a web page asks for, which can send no header."""
    text = urlsafe_b64encode(key.encode()).decode().rstrip("=")
    return ["breakaway.control", f"breakaway.key.{text}"]


@pytest.mark.parametrize("key", [KEY, 'key~"(with)?<all>/{kinds}'])
def test_a_page_sends_its_key_as_the_name_of_a_protocol(tmp_path: Path, key: str) -> None:
    settings = Settings(model_store=tmp_path, api_keys=key, public_paths=("/readyz",))
    with serving(settings) as client:
        wait_until_ready(client)
        with opened(client, protocols=as_protocols(key)) as session:
            assert session.connection.subprotocol == "breakaway.control"
            assert session.ask(START)["type"] == "started"
        over_http = {"Sec-WebSocket-Protocol": ", ".join(as_protocols(key))}
        assert client.get("/info", headers=over_http).status_code == 401


@pytest.mark.parametrize(
    "protocols",
    [
        ["breakaway.control"],
        as_protocols("another-key-0123456789"),
        ["breakaway.control", "breakaway.key."],
        ["breakaway.control", "breakaway.key.x"],
        ["breakaway.control", "breakaway.key.w6nDqcOp"],
        ["breakaway.control", f"breakaway.key.{KEY}"],
    ],
)
def test_a_page_is_told_that_its_key_is_wrong(small: httpx.Client, protocols: list[str]) -> None:
    def counted() -> float:
        labels = {"http_method": "WEBSOCKET", "status": "401"}
        return value(small.get("/metrics").text, "breakaway_requests_total", **labels)

    before = counted()
    with opened(small, protocols=protocols) as session:
        told = session.receive()
        assert (told["type"], told["status"]) == ("error", 401)
        assert told["detail"].startswith("send a valid key")
        assert session.closed()[0] == 4401
    wait_until(lambda: counted() == before + 1)


def test_a_key_as_a_name_opens_nothing_without_the_protocol_of_sessions(
    small: httpx.Client,
) -> None:
    with pytest.raises(InvalidStatus), opened(small, protocols=as_protocols("wrong")[1:]):
        pass


def test_only_pages_of_known_origins_may_open_one(small: httpx.Client) -> None:
    assert refused(small, headers=BEARER, origin="https://bad.example")[0] == 403
    own = str(small.base_url).rstrip("/")
    for origin in ("https://good.example", own):
        with opened(small, BEARER, origin) as session:
            assert session.ask(START)["type"] == "started"


def test_there_are_no_more_sessions_than_may_be(small: httpx.Client) -> None:
    with opened(small, BEARER) as first, opened(small, BEARER):
        status, problem, headers = refused(small, headers=BEARER)
        assert (status, problem["type"]) == (429, "urn:breakaway:problem:busy")
        assert int(headers["Retry-After"]) >= 1
        with opened(small, protocols=as_protocols(KEY)) as refused_page:
            assert refused_page.receive()["problem"] == "urn:breakaway:problem:busy"
            assert refused_page.closed()[0] == 4429
        assert first.ask(START)["type"] == "started"
        text = small.get("/metrics").text
        assert value(text, "breakaway_control_sessions") == 2
    wait_until(lambda: value(small.get("/metrics").text, "breakaway_control_sessions") == 0)


def test_more_steps_than_can_be_in_time_are_refused(client: httpx.Client) -> None:
    hasty = START | {"system": {"time_step": 1e-4}}
    with opened(client) as session:
        told = session.ask(hasty)
        assert (told["status"], told["problem"]) == (429, "urn:breakaway:problem:busy")
        assert session.ask(START)["type"] == "started"


def test_who_says_nothing_is_ended(small: httpx.Client) -> None:
    with opened(small, BEARER) as session:
        session.ask(START)
        session.ask(REST)
        ended = session.receive()
        assert (ended["type"], ended["reason"], ended["step"]) == ("ended", "idle", 1)
        assert session.closed() == (4408, "idle")
        assert ended["carry"]


def test_too_long_a_message_ends_its_session_and_nothing_else(small: httpx.Client) -> None:
    with opened(small, BEARER) as session, opened(small, BEARER) as other:
        session.send("x" * 3000)
        assert session.closed()[0] == 1009
        assert other.ask(START)["type"] == "started"


def send_for_ever(session: Session) -> None:
    while True:
        session.send(REST)


def test_who_does_not_read_is_dropped(tmp_path: Path) -> None:
    with serving(Settings(model_store=tmp_path, send_timeout_s=0.3)) as client:
        wait_until_ready(client)
        with opened(client) as session:
            session.ask(START | {"include": ["plan", "carry"]})
            with pytest.raises(ConnectionClosed):
                send_for_ever(session)
        wait_until(lambda: value(client.get("/metrics").text, "breakaway_control_sessions") == 0)


def test_a_connection_that_drops_ends_its_session_and_nothing_else(
    client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    with opened(client) as other:
        other.ask(START)
        with opened(client) as session:
            session.ask(START)
            session.send(REST)
            session.connection.socket.shutdown(socket.SHUT_RDWR)
        wait_until(lambda: value(client.get("/metrics").text, "breakaway_control_sessions") == 1)
        assert other.ask(REST)["type"] == "control"
    assert [line for line in caplog.records if line.levelno > logging.INFO] == []


def test_a_session_is_one_count(client: httpx.Client) -> None:
    labels = {"route": "/control", "http_method": "WEBSOCKET", "status": "101", "method": "pid"}

    def counted() -> float:
        text = client.get("/metrics").text
        known = "pid" in text and 'http_method="WEBSOCKET",method="pid"' in text
        return value(text, "breakaway_requests_total", **labels) if known else 0.0

    before = counted()
    with opened(client) as session:
        session.ask(START | {"controller": "pid"})
        session.ask({"type": "stop"})
    wait_until(lambda: counted() == before + 1)


@pytest.mark.parametrize("client", ["process"], indirect=True)  # Serve's ingress logs elsewhere
def test_a_session_is_one_line(client: httpx.Client, caplog: pytest.LogCaptureFixture) -> None:
    def lines() -> list[dict[str, Any]]:
        logged = [line.__dict__ for line in caplog.records if line.name == "breakaway.access"]
        return [line for line in logged if line["request_id"] == "session-1"]

    caplog.set_level(logging.INFO)
    with opened(client, {"X-Request-ID": "session-1"}) as session:
        assert session.connection.response is not None
        assert session.connection.response.headers["X-Request-ID"] == "session-1"
        session.ask(START | {"controller": "pid"})
        session.ask(REST)
        session.ask({"type": "stop"})
    wait_until(lambda: bool(lines()))
    (line,) = lines()
    assert (line["path"], line["http_method"], line["status"]) == ("/control", "WEBSOCKET", 101)
    assert (line["steps"], line["late_steps"], line["close_code"]) == (1, 0, 1000)
    assert line["method"] == "pid"
    others = [line for line in caplog.records if line.name.startswith(("uvicorn.error", "app"))]
    assert not others


def test_sessions_are_below_the_root_path_too(tmp_path: Path) -> None:
    with serving(Settings(model_store=tmp_path, root_path="/planner")) as client:
        wait_until_ready(client)
        for base in ("/planner", ""):
            client.base_url = client.base_url.copy_with(path=base)
            assert socket_url(client).endswith(f"{base}/control")
            with opened(client) as session:
                assert session.ask(START)["type"] == "started"


def test_a_service_that_is_starting_takes_no_sessions(tmp_path: Path) -> None:
    (tmp_path / "broken" / "1").mkdir(parents=True)
    (tmp_path / "broken" / "1" / "manifest.json").write_text("{}")
    with serving(Settings(model_store=tmp_path)) as client:
        assert refused(client)[0] == 503
