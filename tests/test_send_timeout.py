"""A client that leaves its answer lying is dropped, over real sockets; one that reads is not."""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic, sleep

import pytest
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.launch import START_SECONDS
from app.settings import Settings
from tests.served import running, wait_until

SEND_TIMEOUT_S = 1.0
GET = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
SMALL = GET.replace(b"/ ", b"/small ")
SMALL_BYTES, LARGE_BYTES = 20_000, 6_000_000
RECEIVED_AT_ONCE = 1 << 16


async def app(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with one large body, or a small one."""
    size = SMALL_BYTES if scope["path"] == "/small" else LARGE_BYTES
    await Response(b"x" * size)(scope, receive, send)


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    """Where the server listens."""
    settings = Settings(send_timeout_s=SEND_TIMEOUT_S, idle_timeout_s=60)
    with running(app, settings=settings) as url:
        host, _, port = url.removeprefix("http://").partition(":")
        yield host, int(port)


@contextmanager
def connected(address: tuple[str, int]) -> Iterator[socket.socket]:
    """Connect with so small a buffer that the server notices who does not read."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVED_AT_ONCE)
        connection.settimeout(START_SECONDS)
        connection.connect(address)
        yield connection


def is_dropped(connection: socket.socket) -> bool:
    """Say whether the server has ended the connection, without reading from it."""
    poll = select.poll()
    poll.register(connection, 0)
    return bool(poll.poll(0))


def read_answer(connection: socket.socket, size: int) -> None:
    """Read an answer of `size` bytes and its head."""
    received = b""
    while len(received.partition(b"\r\n\r\n")[2]) < size:
        part = connection.recv(RECEIVED_AT_ONCE)
        assert part
        received += part
    assert received.endswith(b"\r\n\r\n" + b"x" * size)


def test_a_client_that_never_reads_is_dropped(address: tuple[str, int]) -> None:
    with connected(address) as connection:
        began = monotonic()
        connection.sendall(GET)
        wait_until(lambda: is_dropped(connection))
        assert monotonic() - began >= SEND_TIMEOUT_S


def test_a_client_that_asks_on_and_never_reads_is_dropped(address: tuple[str, int]) -> None:
    with connected(address) as connection:
        connection.sendall(1000 * SMALL)
        wait_until(lambda: is_dropped(connection))


def test_a_client_that_stops_reading_is_dropped(address: tuple[str, int]) -> None:
    with connected(address) as connection:
        connection.sendall(GET)
        assert connection.recv(RECEIVED_AT_ONCE)
        wait_until(lambda: is_dropped(connection))


def test_a_client_whose_connection_is_to_be_closed_and_that_never_reads_is_dropped(
    address: tuple[str, int],
) -> None:
    with connected(address) as connection:
        connection.sendall(GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        wait_until(lambda: is_dropped(connection))


def test_a_client_that_has_read_may_be_silent_and_ask_again(address: tuple[str, int]) -> None:
    with connected(address) as connection:
        for _ in range(2):
            connection.sendall(GET)
            read_answer(connection, LARGE_BYTES)
            sleep(1.2 * SEND_TIMEOUT_S)
        assert not is_dropped(connection)
