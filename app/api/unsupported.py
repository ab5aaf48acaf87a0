"""What HTTP lets a client ask of any server, and this one says that it does not do."""

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from app.api.errors import problem_response
from app.api.middleware import HttpMiddleware


class Unsupported(HttpMiddleware):
    """Answer 417 to unknown expectations, and 400 to a request for a WebSocket.

    Other upgrades are offers that a server may pass over; Java's client makes one of HTTP/2.
    """

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
            refusal = problem_response(
                Request(scope),
                400,
                "there is no WebSocket here; ask by plain HTTP requests",
                slug="no-websocket",
                title="No WebSocket",
            )
        else:
            await self.app(scope, receive, send)
            return
        await refusal(scope, receive, send)


def _items(headers: Headers, name: str) -> set[str]:
    """Return the items of a list in a header, in lower case."""
    items = ",".join(headers.getlist(name)).lower().split(",")
    return {item.strip() for item in items} - {""}
