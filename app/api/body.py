"""The body of a request: what it has to be, and the one place where it is read."""

from email.message import Message
from functools import lru_cache
from typing import Any

from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import request_response

from app.wire.json_text import parse_json

JSON = "application/json"
PARSED_AT_ONCE = 1 << 16
"""Up to so many bytes are parsed in the event loop: it takes a few milliseconds."""
LOCATION = ("body",)
MISSING = {"type": "missing", "loc": LOCATION, "msg": "Field required", "input": None}
AS_IT_IS = "identity"
"""The one content coding: none."""


class UnsupportedContentType(Exception):
    """A body is something else than JSON, by its header."""


class UnsupportedContentEncoding(Exception):
    """A body is compressed, by its header."""


class JsonRoute(APIRoute):
    """A route whose one argument beside the request is its body: JSON in UTF-8.

    FastAPI documents it. It would also solve dependencies that there are none of, and make one
    vague error of much that a body can be: so the body is read and checked here, by its own model,
    and the endpoint is called at once, with `body` and `request`.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.app = request_response(self._answer)

    async def _answer(self, request: Request) -> Response:
        body = await self._read(request)
        response: Response = await self.endpoint(body=body, request=request)
        return response

    async def _read(self, request: Request) -> Any:
        """Read the body of a request, and return it as the route's model.

        Raises:
            UnsupportedContentType: it is not JSON, by its header.
            UnsupportedContentEncoding: it is compressed.
            UnreadableJson: it is not JSON.
            InvalidParts: a part of it is JSON by syntax alone.
            RequestValidationError: it does not fit the model.
        """
        assert self.body_field is not None
        _check(request.headers)
        text = await request.body()
        if len(text) > PARSED_AT_ONCE:
            parsed = await run_in_threadpool(parse_json, text)
        else:
            parsed = parse_json(text)
        if parsed is None:
            raise RequestValidationError([MISSING], body=parsed)
        body, errors = self.body_field.validate(parsed, loc=LOCATION)
        if errors:
            raise RequestValidationError(errors, body=parsed)
        return body


def _check(headers: Headers) -> None:
    """Refuse a body by its headers; a charset is ignored, for JSON has none (RFC 8259, Sect. 11).

    Raises:
        UnsupportedContentType, UnsupportedContentEncoding: as `_Read.of` does.
    """
    codings = ", ".join(headers.getlist("content-encoding"))
    if codings.lower() not in ("", AS_IT_IS):
        raise UnsupportedContentEncoding(f"Content-Encoding is {codings}; send the body as it is")
    sent = headers.get("content-type")
    if not _is_json(sent or "text/plain"):
        given = f"Content-Type is {sent}" if sent else "there is no Content-Type"
        raise UnsupportedContentType(
            f"{given}; the body must be JSON, sent with Content-Type: {JSON}"
        )


@lru_cache(maxsize=256)
def _is_json(content_type: str) -> bool:
    """Say whether a content type is JSON's; clients send few of them, again and again."""
    message = Message()
    message["content-type"] = content_type
    kind, subtype = message.get_content_maintype(), message.get_content_subtype()
    return kind == "application" and (subtype == "json" or subtype.endswith("+json"))
