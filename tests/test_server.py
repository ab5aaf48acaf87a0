"""The server's time limits and what it does with odd connections, over real sockets."""

import asyncio
import socket
from collections.abc import Iterator
from time import perf_counter, sleep

import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.server import listen
from app.settings import Settings
from tests.served import running

HEADER_TIMEOUT_S = 0.3
IDLE_TIMEOUT_S = 1
GET = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer the body, but POST /early at once and GET /slow late."""
    assert scope["type"] == "http"
    request = Request(scope, receive)
    if scope["path"] == "/slow":
        await asyncio.sleep(2 * HEADER_TIMEOUT_S)
    body = b"early" if scope["path"] == "/early" else await request.body()
    await Response(body or b"nothing")(scope, receive, send)


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    """Where the server listens."""
    settings = Settings(header_timeout_s=HEADER_TIMEOUT_S, idle_timeout_s=IDLE_TIMEOUT_S)
    with running(echo, settings=settings) as url:
        host, _, port = url.removeprefix("http://").partition(":")
        yield host, int(port)


@pytest.fixture
def connection(address: tuple[str, int]) -> Iterator[socket.socket]:
    """A fresh connection."""
    with socket.create_connection(address, timeout=5) as connection:
        yield connection


def answer_on(connection: socket.socket) -> bytes:
    """Read one whole answer."""
    received = b""
    while not received.endswith((b"nothing", b"early", b"hello", b"received.")):
        part = connection.recv(65536)
        assert part, received
        received += part
    return received


def seconds_until_closed(connection: socket.socket, trickle: bytes = b"") -> float:
    """Return how long the server keeps the connection, while bytes trickle in one by one."""
    began = perf_counter()
    connection.settimeout(0.02)
    for byte in (*(bytes([byte]) for byte in trickle), *([b""] * 500)):
        try:
            if byte:
                connection.sendall(byte)
            if not connection.recv(65536):
                break
        except TimeoutError:
            continue
        except OSError:
            break
    return perf_counter() - began


def about(seconds: float) -> object:
    return pytest.approx(seconds, abs=0.25)


def test_a_silent_connection_is_closed(connection: socket.socket) -> None:
    assert seconds_until_closed(connection) == about(HEADER_TIMEOUT_S)


def test_a_head_that_trickles_in_is_cut_off(connection: socket.socket) -> None:
    head = GET[:-2] + b"X-Slow: " + b"a" * 400
    assert seconds_until_closed(connection, head) == about(HEADER_TIMEOUT_S)


def test_a_trickle_after_an_answer_is_cut_off(connection: socket.socket) -> None:
    connection.sendall(GET)
    assert answer_on(connection).startswith(b"HTTP/1.1 200 ")
    sleep(1.5 * HEADER_TIMEOUT_S)  # between requests only the idle time runs
    assert seconds_until_closed(connection, GET[:-2] + b"X: " + b"a" * 400) == about(
        HEADER_TIMEOUT_S
    )


def test_a_body_that_trickles_on_after_its_answer_is_cut_off(connection: socket.socket) -> None:
    connection.sendall(b"POST /early HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\n")
    assert answer_on(connection).startswith(b"HTTP/1.1 200 ")
    assert seconds_until_closed(connection, b"a" * 400) == about(HEADER_TIMEOUT_S)


def test_an_idle_connection_is_kept_for_its_own_time(connection: socket.socket) -> None:
    for _ in range(2):
        connection.sendall(GET)
        assert answer_on(connection).startswith(b"HTTP/1.1 200 ")
    assert seconds_until_closed(connection) == about(IDLE_TIMEOUT_S)


def test_an_answer_may_take_longer_than_a_head(connection: socket.socket) -> None:
    connection.sendall(GET.replace(b"/ ", b"/slow "))
    assert answer_on(connection).startswith(b"HTTP/1.1 200 ")


def test_a_head_in_parts_within_the_time_is_read(connection: socket.socket) -> None:
    for part in (GET[:5], GET[5:20], GET[20:]):
        connection.sendall(part)
        sleep(HEADER_TIMEOUT_S / 5)
    answer = answer_on(connection)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert b"server:" not in answer.lower()


def test_an_endless_head_is_refused(connection: socket.socket) -> None:
    connection.sendall(b"GET / HTTP/1.1\r\nX: " + b"a" * 100_000)
    assert answer_on(connection).startswith(b"HTTP/1.1 400 ")


def test_the_body_of_a_request_that_offers_an_upgrade_is_read(connection: socket.socket) -> None:
    offer = b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AA\r\n"
    body = b"Content-Length: 5\r\n\r\nhello"
    connection.sendall(b"POST / HTTP/1.1\r\nHost: x\r\n" + offer + body)
    answer = answer_on(connection)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert answer.endswith(b"hello")


def test_connections_to_a_socket_that_listens_send_at_once() -> None:
    (listener,) = listen("127.0.0.1", 0)
    with listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            # What asyncio looks at before it turns Nagle's algorithm off.
            assert accepted.proto == socket.IPPROTO_TCP
