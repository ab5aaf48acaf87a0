"""What a client may ask of any server by HTTP, and this one says that it does not do."""

from collections.abc import Collection

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection, Request
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.errors import problem_response
from app.api.middleware import HttpMiddleware


class Unsupported(HttpMiddleware):
    """Answer 417 to unknown expectations, 400 to a WebSocket that cannot be, 403 to a strange one.

    Other upgrades are offers that a server may pass over; Java's client makes one of HTTP/2.

    Args:
        app: what comes next.
        origins: whose web pages may open a session, beside the service's own: a browser opens one
            for any page, and asks nobody.
    """

    def __init__(self, app: ASGIApp, origins: Collection[str]) -> None:
        super().__init__(app)
        self.origins = origins

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        unknown = _items(headers, "expect") - {"100-continue"}
        if unknown:
            refusal = problem_response(
                Request(scope),
                417,
                f"cannot meet the expectation {', '.join(sorted(unknown))}; 100-continue is known",
                headers={"Connection": "close"},  # the body may never come
            )
        elif "websocket" in _items(headers, "upgrade"):
            # The server lets no other get here.
            refusal = problem_response(
                Request(scope),
                400,
                "there is no such WebSocket here; GET /control opens one, of version 13",
                slug="no-websocket",
                title="No WebSocket",
            )
        else:
            await self.app(scope, receive, send)
            return
        await refusal(scope, receive, send)

    async def handle_session(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        origin = headers.get("origin")
        own = origin and origin.partition("://")[2] == headers.get("host")
        if origin is None or own or origin in self.origins:
            await self.app(scope, receive, send)
            return
        refusal = problem_response(
            HTTPConnection(scope), 403, "pages of this origin may not open sessions"
        )
        await refusal(scope, receive, send)


def _items(headers: Headers, name: str) -> set[str]:
    """Return the items of a list in a header, in lower case."""
    items = ",".join(headers.getlist(name)).lower().split(",")
    return {item.strip() for item in items} - {""}
