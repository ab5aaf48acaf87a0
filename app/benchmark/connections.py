"""Connections to a service that are kept alive, and cost the machine next to nothing themselves."""

import json
import socket
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from http import HTTPStatus
from time import perf_counter, sleep
from typing import Any

CONNECTIONS = 16
"""Where a service is asked for all that it can do."""
PAUSE_SECONDS = 0.1
"""Before a request is sent again that was refused for the time being."""


class Connection:
    """Keeps a connection alive; its own share of a request is some microseconds.

    Args:
        url: of the service.
    """

    def __init__(self, url: str) -> None:
        host, port = url.removeprefix("http://").split(":")
        self._socket = socket.create_connection((host, int(port)))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def ask(self, request: bytes) -> tuple[float, bytes]:
        """Return how long the answer took, ms, and its body; a busy service (429) is asked again.

        On a machine that is not free even a few connections may be too many for it.
        """
        started = perf_counter()
        status, body = self._exchange(request)
        while status == HTTPStatus.TOO_MANY_REQUESTS:
            sleep(PAUSE_SECONDS)
            status, body = self._exchange(request)
        assert status == HTTPStatus.OK, body
        return (perf_counter() - started) * 1e3, body

    def _exchange(self, request: bytes) -> tuple[int, bytes]:
        self._socket.sendall(request)
        received = b""
        while b"\r\n\r\n" not in received:
            received += self._socket.recv(1 << 16)
        head, _, body = received.partition(b"\r\n\r\n")
        length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n")[0])
        while len(body) < length:
            body += self._socket.recv(1 << 16)
        return int(head.split(b" ", 2)[1]), body

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def written(verb: str, path: str, content: dict[str, Any] | None = None) -> bytes:
    """Return a request as it goes over a connection, with JSON where it has content."""
    body = json.dumps(content).encode() if content else b""
    head = f"{verb} {path} HTTP/1.1\r\nHost: localhost\r\n"
    if content:
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"\r\n" + body


def rate(url: str, requests: Sequence[bytes], count: int) -> float:
    """Ask all of `requests` over `count` connections at once; return how many a second."""

    def ask(number: int) -> None:
        for request in requests[number::count]:
            connections[number].ask(request)

    with ExitStack() as opened:
        connections = [opened.enter_context(closing(Connection(url))) for _ in range(count)]
        threads = opened.enter_context(ThreadPoolExecutor(count))
        started = perf_counter()
        for _ in threads.map(ask, range(count)):
            pass
        return len(requests) / (perf_counter() - started)
