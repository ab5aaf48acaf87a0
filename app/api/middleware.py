"""Pure ASGI middleware around a request's body and verb."""

import asyncio
from math import ceil

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class BodyLimit:
    """Refuse a body above `max_bytes`, declared or streamed (413), or that takes too long (408).

    Starlette's own limiter answers in plain text where the length is declared.

    Args:
        app: what is limited.
        max_bytes: the largest body.
        timeout_s: how long after its head a request's body may take to arrive.
    """

    def __init__(self, app: ASGIApp, max_bytes: int, timeout_s: float) -> None:
        self.app = app
        self.max_bytes = max_bytes
        self.timeout_s = timeout_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        declared = Headers(scope=scope).get("content-length", "")
        deadline = asyncio.get_running_loop().time() + self.timeout_s
        received = 0
        is_complete = False

        def check(size: int) -> None:
            if size > self.max_bytes:
                raise HTTPException(413, f"the body is larger than {self.max_bytes} bytes")

        async def receive_within_limits() -> Message:
            nonlocal received, is_complete
            if is_complete:  # what comes now is that the client hangs up, whenever it does
                return await receive()
            check(int(declared) if declared.isdecimal() else 0)
            try:
                async with asyncio.timeout_at(deadline):
                    message = await receive()
            except TimeoutError:
                detail = f"the body did not arrive within {ceil(self.timeout_s)} s"
                raise HTTPException(408, detail, headers={"Connection": "close"}) from None
            received += len(message.get("body", b""))
            check(received)
            is_complete = not message.get("more_body", False)
            return message

        await self.app(scope, receive_within_limits, send)


class HeadAsGet:
    """Answer HEAD wherever GET is answered; the server leaves the body out."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self.app(scope, receive, send)
            return
        as_get = {**scope, "method": "GET"}
        try:
            await self.app(as_get, receive, send)
        finally:  # the route that matched is the request's, too
            scope.update(as_get, method="HEAD")
