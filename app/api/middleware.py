"""Pure ASGI middleware: what ours has in common, and what minds a request's body and verb."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import ceil

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.paths import route_path

POLICY_VIOLATION = 1008
"""The code with which a WebSocket is refused."""


class HttpMiddleware(ABC):
    """Middleware that knows HTTP: whatever else comes is refused and not let by.

    Of WebSockets, which carry sessions, those are let by that `handle_session` lets by.

    Args:
        app: what comes next.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        match scope["type"]:
            case "http":
                await self.handle(scope, receive, send)
            case "lifespan":
                await self.app(scope, receive, send)
            case "websocket":
                await self.handle_session(scope, receive, send)
            case unknown:
                raise ValueError(f"{type(self).__name__} knows no {unknown}")

    @abstractmethod
    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer an HTTP request, or hand it to `app`."""

    async def handle_session(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002
        """Refuse a WebSocket, or hand it to `app`; refuses it where nothing else is said."""
        await send({"type": "websocket.close", "code": POLICY_VIOLATION})


class RequestMiddleware(HttpMiddleware):
    """Middleware that is about requests and their bodies, and lets sessions by."""

    async def handle_session(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self.app(scope, receive, send)


class BodyTooLarge(Exception):
    """A body is larger than the service takes."""


class BodyTooSlow(Exception):
    """A body took too long to arrive."""


class BodyLimit(RequestMiddleware):
    """Refuse a body above `max_bytes`, declared or streamed (413), or that takes too long (408).

    Starlette's own limiter answers in plain text where the length is declared.

    Args:
        app: what is limited.
        max_bytes: the largest body.
        larger: the largest body of paths that take more.
        timeout_s: how long after its head a request's body may take to arrive.
    """

    def __init__(
        self, app: ASGIApp, max_bytes: int, timeout_s: float, larger: Mapping[str, int]
    ) -> None:
        super().__init__(app)
        self.max_bytes = max_bytes
        self.larger = larger
        self.timeout_s = timeout_s

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        declared = Headers(scope=scope).get("content-length", "")
        deadline = asyncio.get_running_loop().time() + self.timeout_s
        max_bytes = self.larger.get(route_path(scope), self.max_bytes)
        received = 0
        is_complete = False

        def check(size: int) -> None:
            if size > max_bytes:
                raise BodyTooLarge(f"the body is larger than {max_bytes} bytes")

        async def receive_within_limits() -> Message:
            nonlocal received, is_complete
            if is_complete:  # what comes now is that the client hangs up, whenever it does
                return await receive()
            check(int(declared) if declared.isdecimal() else 0)
            try:
                async with asyncio.timeout_at(deadline):
                    message = await receive()
            except TimeoutError:
                limit = ceil(self.timeout_s)
                raise BodyTooSlow(f"the body did not arrive within {limit} s") from None
            received += len(message.get("body", b""))
            check(received)
            is_complete = not message.get("more_body", False)
            return message

        await self.app(scope, receive_within_limits, send)


class HeadAsGet(RequestMiddleware):
    """Answer HEAD wherever GET is answered; the server leaves the body out."""

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] != "HEAD":
            await self.app(scope, receive, send)
            return
        as_get = {**scope, "method": "GET"}
        try:
            await self.app(as_get, receive, send)
        finally:  # the route that matched is the request's, too
            scope.update(as_get, method="HEAD")
