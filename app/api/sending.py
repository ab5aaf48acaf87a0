"""How an answer goes out: as JSON, in parts, compressed where it is large and the client takes it.

Nothing here computes in the event loop but the response, which sends part after part.
"""

import asyncio
import zlib
from collections import deque
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, mmap
from time import sleep
from typing import Any

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.planning.stop import Stop
from app.serving.json_parts import PART_BYTES, PAUSE_SECONDS, json_parts

GZIP_LEVEL = 1
GZIP_WINDOW = 16 + zlib.MAX_WBITS
"""zlib writes gzip's head and tail, too."""


@dataclass(frozen=True, slots=True)
class Body:
    """An answer's body, as it is sent."""

    parts: deque[bytes | mmap]
    is_gzip: bool

    @property
    def num_bytes(self) -> int:
        """The length of what is still to be sent."""
        return sum(map(len, self.parts))

    def append(self, part: bytes) -> None:
        """Add a part, and keep it in memory of its own.

        The C library would keep what is freed in its heap; this goes back to the system at once.
        """
        if part:
            memory = mmap(-1, len(part), flags=MAP_PRIVATE | MAP_ANONYMOUS)
            memory.write(part)
            self.parts.append(memory)


def make_body(answer: Any, *, accepts_gzip: bool, stop: Stop) -> Body:
    """Write an answer as JSON, and let others have the interpreter between its parts.

    Args:
        answer: for `json_parts`.
        accepts_gzip: whether the client would have it compressed.
        stop: whether it is still wanted.

    Raises:
        Stopped: it is not.
    """
    parts = json_parts(answer)
    first = next(parts)
    if len(first) < PART_BYTES:
        return Body(deque([first]), is_gzip=False)
    compressor = zlib.compressobj(GZIP_LEVEL, wbits=GZIP_WINDOW) if accepts_gzip else None
    body = Body(deque(), compressor is not None)
    for part in chain([first], parts):
        body.append(compressor.compress(part) if compressor else part)
        stop.check()
        sleep(PAUSE_SECONDS)
    if compressor:
        body.append(compressor.flush())
    return body


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
