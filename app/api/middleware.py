"""Pure ASGI middleware."""

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class BodyLimit:
    """Refuse a request body above `max_bytes`, declared or streamed, with 413.

    Starlette's own limiter answers in plain text where the length is declared.
    """

    def __init__(self, app: ASGIApp, max_bytes: int) -> None:
        self.app = app
        self.max_bytes = max_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        declared = Headers(scope=scope).get("content-length", "")
        received = 0

        def check(size: int) -> None:
            if size > self.max_bytes:
                raise HTTPException(413, f"the body is larger than {self.max_bytes} bytes")

        async def receive_within_limit() -> Message:
            nonlocal received
            check(int(declared) if declared.isdecimal() else 0)
            message = await receive()
            received += len(message.get("body", b""))
            check(received)
            return message

        await self.app(scope, receive_within_limit, send)
