"""The server's time limits and what it does with odd connections, over real sockets."""

import asyncio
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter, sleep
from typing import TypeAlias

import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.launch import START_SECONDS
from app.settings import Settings
from tests.served import running

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
    while not received.endswith((b"nothing", b"early", b"hello", b"received.")):
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


def test_an_endless_head_is_refused(patient: Connect) -> None:
    connection = patient()
    connection.sendall(b"GET / HTTP/1.1\r\nX: " + b"a" * 100_000)
    assert answer_on(connection).startswith(b"HTTP/1.1 400 ")


def test_the_body_of_a_request_that_offers_an_upgrade_is_read(patient: Connect) -> None:
    connection = patient()
    offer = b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AA\r\n"
    body = b"Content-Length: 5\r\n\r\nhello"
    connection.sendall(b"POST / HTTP/1.1\r\nHost: x\r\n" + offer + body)
    answer = answer_on(connection)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert answer.endswith(b"hello")
