"""What HTTP, validation and threads add to a plan, beside a request that asks for nothing."""

import json
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from time import perf_counter
from typing import Any

from app.launch import launch

ROUNDS, CALLS = 20, 20
CONNECTIONS, REQUESTS_EACH = 16, 60
PLAN = {
    "initial_state": [0.0, 0.0],
    "target_state": [0.5, 0.0],
    "seed": 1,
    "method": "dataset_prior",
    "refine": True,
    "reachability": False,
    "include": [],
}


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
        """Return how long the answer took, ms, and its body."""
        started = perf_counter()
        self._socket.sendall(request)
        received = b""
        while b"\r\n\r\n" not in received:
            received += self._socket.recv(1 << 16)
        head, _, body = received.partition(b"\r\n\r\n")
        length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n")[0])
        while len(body) < length:
            body += self._socket.recv(1 << 16)
        assert head.startswith(b"HTTP/1.1 200")
        return (perf_counter() - started) * 1e3, body


def requests() -> Iterator[str]:
    """Ask in turns for a plan and whether the service lives; yield a Markdown list."""
    livez, plan = _written("GET", "/livez"), _written("POST", "/plan", PLAN)
    # With its log, which is a part of what a request takes.
    with launch("app", "serve", "--log-format", "json") as server:
        connection, nothing, beyond = Connection(server.url), list[float](), list[float]()
        for number in range(ROUNDS + 1):
            for _ in range(CALLS):
                took, _ = connection.ask(livez)
                nothing.append(took)
            for _ in range(CALLS):
                took, answer = connection.ask(plan)
                beyond.append(took - json.loads(answer)["timing_ms"]["total"])
            if number == 0:  # the first ones load what later ones have
                nothing, beyond = [], []
        yield (
            f"- /livez: {median(nothing):.2f} ms; /plan (dataset_prior, refined, without the "
            f"floor) beyond its own total: {median(beyond):.2f} ms, ratio "
            f"{median(beyond) / median(nothing):.2f}"
        )
        for count in (1, CONNECTIONS):
            rate = _rate(server.url, plan, count)
            yield f"- the same over {count} connections: {rate:.0f} plans/s"


def _written(verb: str, path: str, content: dict[str, Any] | None = None) -> bytes:
    body = json.dumps(content).encode() if content else b""
    head = f"{verb} {path} HTTP/1.1\r\nHost: localhost\r\n"
    if content:
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"\r\n" + body


def _rate(url: str, request: bytes, count: int) -> float:
    """Return plans per second."""

    def ask(connection: Connection) -> None:
        for _ in range(REQUESTS_EACH):
            connection.ask(request)

    connections = [Connection(url) for _ in range(count)]
    with ThreadPoolExecutor(count) as threads:
        started = perf_counter()
        for _ in threads.map(ask, connections):
            pass
        return count * REQUESTS_EACH / (perf_counter() - started)
