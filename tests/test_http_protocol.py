"""Time limits, odd connections, what is no HTTP, and who is behind a proxy, over real sockets."""

import asyncio
import json
import logging
import re
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter, sleep
from typing import Any, TypeAlias

import httpx
import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.launch import START_SECONDS
from app.server import Server, listen
from app.settings import Settings
from tests.metrics import value
from tests.served import running, serving, wait_until

TIMEOUT_S = 0.3
"""Of the limit that a test is about; the server's others are so long that none of them comes in."""
Connect: TypeAlias = Callable[[], socket.socket]
GET = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer the body, but POST /early at once and GET /slow late."""
    assert scope["type"] == "http"
    request = Request(scope, receive)
    if scope["path"] == "/slow":
        await asyncio.sleep(2 * TIMEOUT_S)
    body = b"early" if scope["path"] == "/early" else await request.body()
    await Response(body or b"nothing")(scope, receive, send)


@contextmanager
def serving_echo(settings: Settings) -> Iterator[Connect]:
    """Yield the road to a fresh connection to a server with these limits."""
    with running(echo, settings=settings) as url, ExitStack() as connections:
        host, _, port = url.removeprefix("http://").partition(":")

        def connect() -> socket.socket:
            connection = socket.create_connection((host, int(port)), timeout=START_SECONDS)
            return connections.enter_context(connection)

        yield connect


@pytest.fixture(scope="module")
def impatient_for_heads() -> Iterator[Connect]:
    """A server that waits for heads for a short time only."""
    settings = Settings(header_timeout_s=TIMEOUT_S, idle_timeout_s=10 * START_SECONDS)
    with serving_echo(settings) as connect:
        yield connect


@pytest.fixture(scope="module")
def patient() -> Iterator[Connect]:
    """A server that waits for heads, but keeps idle connections for a second only."""
    with serving_echo(Settings(header_timeout_s=START_SECONDS, idle_timeout_s=1)) as connect:
        yield connect


def answer_on(connection: socket.socket) -> bytes:
    """Read one whole answer."""
    received = b""
    while not received.endswith((b"nothing", b"early", b"hello")):
        part = connection.recv(65536)
        assert part, received
        received += part
    return received


def trickle_until_closed(connection: socket.socket, content: bytes) -> None:
    """Send byte by byte; there are too many of them to get to the end."""
    connection.settimeout(0.05)
    for byte in content:
        try:
            connection.sendall(bytes([byte]))
            if not connection.recv(65536):
                return
        except TimeoutError:
            continue
        except OSError:
            return
    pytest.fail("the connection is kept")


ENDLESS = b"X-Slow: " + b"a" * 2000


def test_a_silent_connection_is_closed(impatient_for_heads: Connect) -> None:
    assert impatient_for_heads().recv(1) == b""


def test_a_head_that_trickles_in_is_cut_off(impatient_for_heads: Connect) -> None:
    began = perf_counter()
    trickle_until_closed(impatient_for_heads(), GET[:-2] + ENDLESS)
    assert perf_counter() - began >= TIMEOUT_S


def test_a_trickle_after_an_answer_is_cut_off(impatient_for_heads: Connect) -> None:
    connection = impatient_for_heads()
    connection.sendall(GET)
    assert answer_on(connection).startswith(b"HTTP/1.1 200 ")
    sleep(1.5 * TIMEOUT_S)  # between requests only the idle time runs
    began = perf_counter()
    trickle_until_closed(connection, GET[:-2] + ENDLESS)
    assert perf_counter() - began >= TIMEOUT_S


def test_a_body_that_trickles_on_after_its_answer_is_cut_off(
    impatient_for_heads: Connect,
) -> None:
    connection = impatient_for_heads()
    connection.sendall(b"POST /early HTTP/1.1\r\nHost: x\r\nContent-Length: 9000\r\n\r\n")
    assert answer_on(connection).startswith(b"HTTP/1.1 200 ")
    trickle_until_closed(connection, b"a" * 2000)


def test_an_idle_connection_is_kept_for_its_own_time(patient: Connect) -> None:
    connection = patient()
    for _ in range(2):
        began = perf_counter()
        connection.sendall(GET)
        assert answer_on(connection).startswith(b"HTTP/1.1 200 ")
    assert connection.recv(1) == b""
    assert perf_counter() - began >= 1


def test_an_answer_may_take_longer_than_a_head(impatient_for_heads: Connect) -> None:
    connection = impatient_for_heads()
    connection.sendall(GET.replace(b"/ ", b"/slow "))
    assert answer_on(connection).startswith(b"HTTP/1.1 200 ")


def test_a_head_in_parts_within_the_time_is_read(patient: Connect) -> None:
    connection = patient()
    for part in (GET[:5], GET[5:20], GET[20:]):
        connection.sendall(part)
        sleep(TIMEOUT_S / 5)
    answer = answer_on(connection)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert b"server:" not in answer.lower()


def test_the_body_of_a_request_that_offers_an_upgrade_is_read(patient: Connect) -> None:
    connection = patient()
    offer = b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AA\r\n"
    body = b"Content-Length: 5\r\n\r\nhello"
    connection.sendall(b"POST / HTTP/1.1\r\nHost: x\r\n" + offer + body)
    answer = answer_on(connection)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert answer.endswith(b"hello")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service without models."""
    with serving(Settings(model_store=tmp_path_factory.mktemp("empty"))) as client:
        yield client


@pytest.fixture
def logged(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    """What is logged, requests too."""
    caplog.set_level(logging.INFO)
    return caplog


def send(service: httpx.Client, *parts: bytes) -> list[tuple[int, dict[str, str], Any]]:
    """Send parts one after the other, each once the last one was answered or is on its way.

    Returns:
        Status, headers and JSON of each answer, until the server ends the connection.
    """
    received = b""
    address = (service.base_url.host, service.base_url.port)
    with socket.create_connection(address, timeout=START_SECONDS) as connection:
        for part in parts:
            connection.sendall(part)
            sleep(0.1)
        while data := connection.recv(65536):
            received += data
    answers = []
    for answer in re.split(rb"(?=HTTP/1\.1 )", received)[1:]:
        head, _, body = answer.decode().partition("\r\n\r\n")
        status, *lines = head.split("\r\n")
        headers = dict(line.lower().split(": ", 1) for line in lines)
        answers.append((int(status.split(" ")[1]), headers, json.loads(body)))
    return answers


def lines_of(logged: pytest.LogCaptureFixture, count: int) -> list[dict[str, Any]]:
    """Return the access lines, once there are as many; they follow the answers."""

    def lines() -> list[dict[str, Any]]:
        return [line.__dict__ for line in logged.records if line.name == "breakaway.access"]

    wait_until(lambda: len(lines()) >= count)
    assert len(lines()) == count
    assert not [line for line in logged.records if line.levelno > logging.INFO]
    return lines()


HEAD = b"POST /plan HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nX-Request-ID: mine\r\n"


@pytest.mark.parametrize(
    ("head", "status", "reason"),
    [
        (b"rubbish\r\n\r\n", 400, "illegal request line"),
        (b"\x16\x03\x01\x02\x00\x01\r\n\r\n", 400, "illegal request line"),
        (b"GET / HTTP/1.1\r\n\r\n", 400, "Host"),
        (b"GET / HTTP/1.1\r\nHost: x\r\nbad header\r\n\r\n", 400, "illegal header line"),
        (HEAD + b"Content-Length: 1, 2\r\n\r\n", 400, "Content-Length"),
        (b"GET / HTTP/1.1\r\nX: " + b"a" * 100_000, 431, "too long"),
        (HEAD + b"Transfer-Encoding: gzip\r\n\r\n", 501, "chunked"),
    ],
)
def test_a_head_that_is_no_http_is_a_problem_with_an_id_and_one_log_line(
    service: httpx.Client,
    logged: pytest.LogCaptureFixture,
    head: bytes,
    status: int,
    reason: str,
) -> None:
    counted = {"route": "unmatched", "http_method": "other", "status": str(status)}
    before = value(service.get("/metrics").text, "breakaway_requests_total", **counted)
    logged.clear()
    ((answered, headers, problem),) = send(service, head)
    assert answered == problem["status"] == status
    assert problem["type"] == "urn:breakaway:problem:malformed-http"
    assert reason in problem["detail"]
    assert "bytearray" not in problem["detail"]
    assert headers["content-type"] == "application/problem+json"
    assert headers["connection"] == "close"
    (line,) = lines_of(logged, 1)
    assert re.fullmatch("[0-9a-f]{32}", line["request_id"])
    assert line["request_id"] == headers["x-request-id"]
    assert line["status"] == status
    assert line["client"] == "127.0.0.1"
    assert reason in line["malformed"]
    after = value(service.get("/metrics").text, "breakaway_requests_total", **counted)
    assert after == before + 1


def test_rubbish_behind_a_request_has_an_id_of_its_own(
    service: httpx.Client, logged: pytest.LogCaptureFixture
) -> None:
    good = b"GET /nope HTTP/1.1\r\nHost: x\r\nX-Request-ID: mine\r\n\r\n"
    for parts in ([good + b"rubbish\r\n\r\n"], [good, b"rubbish\r\n\r\n"]):
        logged.clear()
        first, second = send(service, *parts)
        assert (first[0], first[1]["x-request-id"]) == (404, "mine")
        assert second[0] == 400
        ids = {line["path"]: line["request_id"] for line in lines_of(logged, 2)}
        assert ids == {"/nope": "mine", "-": second[1]["x-request-id"]}
        assert second[1]["x-request-id"] != "mine"


@pytest.mark.parametrize("in_one", [True, False])
def test_a_body_that_is_no_http_is_its_request_s_problem(
    service: httpx.Client, logged: pytest.LogCaptureFixture, in_one: bool
) -> None:
    parts = [HEAD + b"Transfer-Encoding: chunked\r\n\r\n1\r\n{\r\n", b"zzz\r\n"]
    ((status, headers, problem),) = send(service, *([b"".join(parts)] if in_one else parts))
    assert status == 400
    assert problem["type"] == "urn:breakaway:problem:malformed-http"
    assert "illegal chunk header" in problem["detail"]
    assert problem["instance"] == "/plan"
    assert headers["x-request-id"] == "mine"
    (line,) = lines_of(logged, 1)
    assert (line["route"], line["request_id"], line["status"]) == ("/plan", "mine", 400)


def test_a_body_that_is_no_http_and_that_nobody_waits_for_ends_the_connection(
    service: httpx.Client, logged: pytest.LogCaptureFixture
) -> None:
    head = HEAD.replace(b"/plan", b"/nope") + b"Transfer-Encoding: chunked\r\n\r\n"
    ((status, headers, _),) = send(service, head, b"zzz\r\n")
    assert status == 404
    assert headers["x-request-id"] == "mine"
    lines_of(logged, 1)


async def who(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer how the request came, and from whom."""
    assert scope["type"] == "http"
    await Response(f"{scope['scheme']} {scope['client'][0]}")(scope, receive, send)


FORWARDED = {"X-Forwarded-Proto": "https", "X-Forwarded-For": "203.0.113.9, 10.1.2.3"}


@pytest.mark.parametrize(
    ("trusted", "seen"),
    [
        ((), "http 127.0.0.1"),
        (("10.0.0.0/8",), "http 127.0.0.1"),
        (("127.0.0.1", "::1"), "https 10.1.2.3"),
        (("127.0.0.0/8", "10.0.0.0/8"), "https 203.0.113.9"),
        (("*",), "https 203.0.113.9"),
    ],
)
def test_only_trusted_proxies_are_believed(trusted: tuple[str, ...], seen: str) -> None:
    with running(who, settings=Settings(trusted_proxies=trusted)) as url:
        assert httpx.get(url, headers=FORWARDED).text == seen


def test_an_ipv4_address_is_one_on_a_socket_for_both_families() -> None:
    server = Server(who, Settings(trusted_proxies=("127.0.0.0/8",)))
    sockets = listen("::", 0)
    thread = threading.Thread(target=server.run, kwargs={"sockets": sockets})
    thread.start()
    try:
        wait_until(lambda: server.started)
        url = f"http://127.0.0.1:{sockets[0].getsockname()[1]}"
        assert httpx.get(url).text == "http 127.0.0.1"
        assert httpx.get(url, headers=FORWARDED).text == "https 10.1.2.3"
    finally:
        server.should_exit = True
        thread.join()
