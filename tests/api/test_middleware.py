"""Bodies that are too large or too slow, over real sockets; HEAD; and what is not HTTP."""

import asyncio
import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, sleep
from typing import TypeAlias

import httpx
import pytest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.keys import ApiKeys
from app.api.metrics import Metrics
from app.api.middleware import BodyLimit, HeadAsGet, HttpMiddleware
from app.api.request_target import RequestTarget
from app.api.telemetry import Telemetry
from app.api.unsupported import Unsupported
from app.launch import START_SECONDS
from app.settings import Settings
from tests.metrics import value
from tests.served import serving, wait_until

TIMEOUT_S = 0.3
TRICKLED = 900
"""Bytes, fewer than a body may have: they take a minute and a half."""
HEAD = "POST /plan HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service without models with small limits."""
    store = tmp_path_factory.mktemp("empty")
    settings = Settings(model_store=store, max_body_bytes=1000, body_timeout_s=TIMEOUT_S)
    with serving(settings) as client:
        yield client


@contextmanager
def connected(client: httpx.Client) -> Iterator[socket.socket]:
    address = (client.base_url.host, client.base_url.port)
    with socket.create_connection(address, timeout=START_SECONDS) as connection:
        yield connection


def read_all(connection: socket.socket) -> str:
    """Read until the other side closes."""
    received = b""
    while part := connection.recv(65536):
        received += part
    return received.decode()


@pytest.mark.parametrize("sent", ["Content-Length: 20\r\n\r\n", "Content-Length: 20\r\n\r\n{"])
def test_a_body_that_stops_is_answered_408(client: httpx.Client, sent: str) -> None:
    with connected(client) as connection:
        began = perf_counter()
        connection.sendall((HEAD + sent).encode())
        answer = read_all(connection)
    assert perf_counter() - began >= TIMEOUT_S
    assert answer.startswith("HTTP/1.1 408 ")
    assert "connection: close" in answer.lower()
    assert "application/problem+json" in answer
    assert "urn:breakaway:problem:body-too-slow" in answer
    assert "x-request-id" in answer


def test_a_trickle_does_not_prolong_the_time(client: httpx.Client) -> None:
    with connected(client) as connection:
        connection.sendall((HEAD + "Transfer-Encoding: chunked\r\n\r\n").encode())
        connection.settimeout(0.1)
        answer = b""
        for _ in range(TRICKLED):
            try:
                connection.sendall(b"1\r\n \r\n")
                answer = connection.recv(65536)
                break
            except TimeoutError:
                continue
    assert answer.startswith(b"HTTP/1.1 408 ")


def test_a_slow_body_within_the_time_is_read(tmp_path: Path) -> None:
    patient = Settings(model_store=tmp_path, body_timeout_s=START_SECONDS)
    with serving(patient) as client, connected(client) as connection:
        connection.sendall((HEAD + "Connection: close\r\nContent-Length: 2\r\n\r\n{").encode())
        sleep(TIMEOUT_S / 3)
        connection.sendall(b"]")
        assert read_all(connection).startswith("HTTP/1.1 400 ")


def test_a_client_that_hangs_up_within_its_body_is_no_error(
    client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    def gone() -> float:
        metrics = client.get("/metrics").text
        return value(metrics, "breakaway_requests_total", route="/plan", status="499")

    before = gone()
    with connected(client) as connection:
        connection.sendall((HEAD + "Content-Length: 20\r\n\r\n{").encode())
    wait_until(lambda: gone() == before + 1)
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []


@pytest.mark.parametrize(
    "sent",
    [
        "Content-Length: 1001\r\n\r\n",
        "Transfer-Encoding: chunked\r\n\r\n3e9\r\n" + " " * 1001 + "\r\n0\r\n\r\n",
        "Transfer-Encoding: chunked\r\n\r\n" + ("64\r\n" + " " * 100 + "\r\n") * 11,
        "Content-Length: 99999999999999999999\r\n\r\n",
    ],
)
def test_a_large_body_is_refused_declared_or_chunked(client: httpx.Client, sent: str) -> None:
    with connected(client) as connection:
        connection.sendall((HEAD + sent).encode())
        assert connection.recv(65536).startswith(b"HTTP/1.1 413 ")


def test_more_than_was_announced_is_not_part_of_the_body(client: httpx.Client) -> None:
    body = "{]"
    with connected(client) as connection:
        announced = f"Content-Length: {len(body)}\r\n\r\n{body}"
        connection.sendall((HEAD + announced + "x" * 5000 + "\r\n\r\n").encode())
        answer = read_all(connection)
    assert answer.startswith("HTTP/1.1 400 ")
    assert "Not JSON" in answer
    assert answer.count("HTTP/1.1 ") == 2  # the rest is no request
    assert answer.count("HTTP/1.1 400 ") == 2


@pytest.mark.parametrize("path", ["/livez", "/metrics", "/docs", "/openapi.json"])
def test_head_is_get_without_a_body(client: httpx.Client, path: str) -> None:
    get, head = client.get(path), client.head(path)
    assert head.status_code == get.status_code == 200
    assert head.headers["content-type"] == get.headers["content-type"]
    assert not head.content


def test_other_verbs_are_told_which_there_are(client: httpx.Client) -> None:
    for verb in ("OPTIONS", "DELETE", "HEAD", "GET"):
        answer = client.request(verb, "/plan")
        assert answer.status_code == 405
        assert answer.headers["allow"] == "POST"


def test_a_slow_body_is_documented(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    assert "ProblemDetails" in document["components"]["schemas"]
    for operations in document["paths"].values():
        for operation in operations.values():
            assert ("408" in operation["responses"]) == ("requestBody" in operation)
            assert "401" not in operation["responses"]


Wrap: TypeAlias = Callable[[ASGIApp], HttpMiddleware]
MIDDLEWARE: list[Wrap] = [
    HeadAsGet,
    lambda app: BodyLimit(app, 1000, 1.0, {}),
    lambda app: ApiKeys(app, [], ["/"]),
    lambda app: RequestTarget(app, ""),
    lambda app: Telemetry(app, Metrics()),
    lambda app: Unsupported(app, []),
]


def pass_through(wrap: Wrap, scope: Scope) -> tuple[bool, list[Message]]:
    """Return whether the middleware let a scope by, and what it sent itself."""
    let_by, sent = False, []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG001
        nonlocal let_by
        let_by = True

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    async def send(message: Message) -> None:
        sent.append(message)

    asyncio.run(wrap(app)(scope, receive, send))
    return let_by, sent


class Careless(HttpMiddleware):
    async def handle(self, *_: object) -> None:
        raise AssertionError


WEBSOCKET = {"type": "websocket", "path": "/", "headers": []}


def test_a_websocket_is_refused_and_not_let_by_where_nothing_is_said_of_it() -> None:
    assert pass_through(Careless, WEBSOCKET) == (False, [{"type": "websocket.close", "code": 1008}])


def test_a_websocket_needs_a_key_as_a_request_does() -> None:
    scope = WEBSOCKET | {
        "scheme": "ws",
        "server": ("x", 80),
        "query_string": b"",
        "extensions": {"websocket.http.response": {}},
    }
    let_by, sent = pass_through(lambda app: ApiKeys(app, [b"digest"], ["/livez"]), scope)
    assert not let_by
    assert (sent[0]["type"], sent[0]["status"]) == ("websocket.http.response.start", 401)


@pytest.mark.parametrize("wrap", MIDDLEWARE)
def test_the_lifespan_goes_by_and_what_nobody_knows_is_an_error(
    wrap: Wrap,
) -> None:
    assert pass_through(wrap, {"type": "lifespan"}) == (True, [])
    with pytest.raises(ValueError, match="carrier-pigeon"):
        pass_through(wrap, {"type": "carrier-pigeon"})
