"""Every request is answered once, over as many connections as were asked for."""

import asyncio
from collections import Counter

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.benchmark import connections
from tests.served import running


class Service:
    """Answers only when so many are under way; what it refuses at first, it answers then.

    Args:
        at_once: how many.
        refused: bodies that get a 429 once.
    """

    def __init__(self, at_once: int, *refused: bytes) -> None:
        self.answered: Counter[bytes] = Counter()
        self.clients: set[object] = set()
        self._all_here = asyncio.Barrier(at_once)
        self._refused = list(refused)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        body = await Request(scope, receive).body()
        self.clients.add(tuple(scope["client"]))
        if body in self._refused:
            self._refused.remove(body)
            await Response("busy", 429)(scope, receive, send)
            return
        await self._all_here.wait()
        self.answered[body] += 1
        await Response(body)(scope, receive, send)


def test_all_are_asked_over_so_many_connections_and_again_while_the_service_is_busy() -> None:
    requests = [connections.written("POST", "/plan", {"seed": seed}) for seed in range(12)]
    bodies = [request.partition(b"\r\n\r\n")[2] for request in requests]
    service = Service(3, bodies[4], bodies[7])

    with running(service) as url:
        assert connections.rate(url, requests, 3) > 0

    assert service.answered == Counter(bodies)
    assert len(service.clients) == 3
