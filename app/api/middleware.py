"""Pure ASGI middleware: what ours has in common, and what minds a request's body and verb."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import ceil
from types import MappingProxyType

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY_VIOLATION = 1008
"""The code with which a WebSocket is refused."""


def route_path(scope: Scope) -> str:
    """Return a request's path as the routes have it, without the root path."""
    path: str = scope["path"]
    return path.removeprefix(mount_path(scope))


def mount_path(scope: Scope) -> str:
    """Return the root path of the whole service, within a mounted application, too."""
    path: str = scope.get("app_root_path", scope.get("root_path", ""))
    return path


class HttpMiddleware(ABC):
    """Middleware that knows HTTP: whatever else comes, a WebSocket say, is refused and not let by.

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
                await send({"type": "websocket.close", "code": POLICY_VIOLATION})
            case unknown:
                raise ValueError(f"{type(self).__name__} knows no {unknown}")

    @abstractmethod
    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer an HTTP request, or hand it to `app`."""


class BodyTooLarge(Exception):
    """A body is larger than the service takes."""


class BodyTooSlow(Exception):
    """A body took too long to arrive."""


class BodyLimit(HttpMiddleware):
    """Refuse a body above `max_bytes`, declared or streamed (413), or that takes too long (408).

    Starlette's own limiter answers in plain text where the length is declared.

    Args:
        app: what is limited.
        max_bytes: the largest body.
        timeout_s: how long after its head a request's body may take to arrive.
        larger: the largest body of those paths that take a larger one.
    """

    def __init__(
        self,
        app: ASGIApp,
        max_bytes: int,
        timeout_s: float,
        larger: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        super().__init__(app)
        self.max_bytes = max_bytes
        self.larger = larger
        self.timeout_s = timeout_s

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        max_bytes = self.larger.get(route_path(scope), self.max_bytes)
        declared = Headers(scope=scope).get("content-length", "")
        deadline = asyncio.get_running_loop().time() + self.timeout_s
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


class HeadAsGet(HttpMiddleware):
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
