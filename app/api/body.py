"""The body of a request: what it has to be, and the one place where it is read."""

from collections.abc import Callable, Coroutine
from email.message import Message
from typing import Any

from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response

from app.wire.json_text import parse_json

JSON = "application/json"
PARSED_AT_ONCE = 1 << 16
"""Up to so many bytes are parsed in the event loop: it takes a few milliseconds."""
AS_IT_IS = "identity"
"""The one content coding: none."""


class UnsupportedContentType(Exception):
    """A body is something else than JSON, by its header."""


class UnsupportedContentEncoding(Exception):
    """A body is compressed, by its header."""


class JsonRoute(APIRoute):
    """A route whose body, where it has one, is JSON in UTF-8."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handle = super().get_route_handler()

        async def read_and_handle(request: Request) -> Response:
            return await handle(await _Read.of(request))

        return read_and_handle if self.body_field else handle


class _Read(Request):
    """A request whose body was read and parsed before FastAPI asks for it.

    FastAPI would make one vague error of much that a body can be, and let the rest by.
    """

    text: bytes
    parsed: Any

    @classmethod
    async def of(cls, request: Request) -> "_Read":
        """Read the body of a request.

        Raises:
            UnsupportedContentType: it is not JSON, by its header.
            UnsupportedContentEncoding: it is compressed.
            UnreadableJson: it is not JSON.
            InvalidParts: a part of it is JSON by syntax alone.
        """
        _check(request.headers)
        read = cls(request.scope, request.receive)
        read.text = await request.body()
        if len(read.text) > PARSED_AT_ONCE:
            read.parsed = await run_in_threadpool(parse_json, read.text)
        else:
            read.parsed = parse_json(read.text)
        return read

    async def body(self) -> bytes:
        return self.text

    async def json(self) -> Any:
        return self.parsed


def _check(headers: Headers) -> None:
    """Refuse a body by its headers; a charset is ignored, for JSON has none (RFC 8259, Sect. 11).

    Raises:
        UnsupportedContentType, UnsupportedContentEncoding: as `_Read.of` does.
    """
    codings = ", ".join(headers.getlist("content-encoding"))
    if codings.lower() not in ("", AS_IT_IS):
        raise UnsupportedContentEncoding(f"Content-Encoding is {codings}; send the body as it is")
    sent = headers.get("content-type")
    message = Message()
    message["content-type"] = sent or "text/plain"
    kind, subtype = message.get_content_maintype(), message.get_content_subtype()
    if kind != "application" or not (subtype == "json" or subtype.endswith("+json")):
        given = f"Content-Type is {sent}" if sent else "there is no Content-Type"
        raise UnsupportedContentType(
            f"{given}; the body must be JSON, sent with Content-Type: {JSON}"
        )
