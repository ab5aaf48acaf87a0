"""How an answer goes out: part after part, as fast as the client takes them."""

import asyncio
from contextlib import ExitStack
from functools import lru_cache

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.serving.bodies import Body


@lru_cache(maxsize=256)
def accepts_gzip(accept_encoding: str) -> bool:
    """Say whether a client would rather have gzip than nothing, by its Accept-Encoding header.

    An encoding that is not named is worth what * is; none at all, which need not be named, is
    worth 0 unless it is.
    """
    worth: dict[str, float] = {}
    for item in accept_encoding.lower().split(","):
        name, *parameters = (word.strip() for word in item.split(";"))
        worth[name] = _quality(parameters)
    gzip = worth.get("gzip", worth.get("x-gzip", worth.get("*", 0.0)))
    return gzip > 0 and gzip >= worth.get("identity", 0.0)


def _quality(parameters: list[str]) -> float:
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                return float(value)
            except ValueError:
                return 0.0
    return 1.0


class PartedResponse(Response):
    """Sends its body itself, part by part; the base of those that do.

    The server waits before a part until the client's connection takes it.

    Args:
        until_sent: ends when the body is sent, or will not be.
        headers: of the answer; without a Content-Length it is sent in chunks.
    """

    def __init__(self, until_sent: ExitStack, headers: dict[str, str]) -> None:
        super().__init__(headers=headers)
        if "Content-Length" not in headers:
            del self.headers["Content-Length"]
        self._until_sent = until_sent

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002
        start = {"status": self.status_code, "headers": self.raw_headers}
        with self._until_sent:
            await send({"type": "http.response.start", **start})
            await self.send_body(send)

    async def send_body(self, send: Send) -> None:
        """Send all parts; the last one says that it is."""
        raise NotImplementedError


class AnswerResponse(PartedResponse):
    """Sends a body of known length and lets go of each part.

    Args:
        body: what to send.
        headers: further ones.
        until_sent: ends when the body is sent, or will not be.
    """

    media_type = "application/json"

    def __init__(self, body: Body, headers: dict[str, str], until_sent: ExitStack) -> None:
        sent_as = {"Content-Encoding": "gzip"} if body.is_gzip else {}
        length = {"Content-Length": str(body.num_bytes), "Vary": "Accept-Encoding"}
        super().__init__(until_sent, headers | length | sent_as)
        self._parts = body.parts

    async def send_body(self, send: Send) -> None:
        """Send all parts."""
        while self._parts:
            part = self._parts.popleft()
            is_last = not self._parts
            message = {"type": "http.response.body", "body": part[:], "more_body": not is_last}
            await send(message)
            if not is_last:
                await asyncio.sleep(0)  # a connection that takes all would keep the others
