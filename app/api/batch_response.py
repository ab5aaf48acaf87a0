"""A batch's answer: lines of JSON as they are done, as fast as the client takes them."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import ExitStack, aclosing

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.serving.batches import Batch
from app.serving.refusals import ClientGone

NDJSON = "application/x-ndjson"


class BatchResponse(Response):
    """Sends the parts of a batch; the next one is begun when the client has taken one.

    Args:
        batch: what is asked for.
        parts: each with its lines, in pieces.
        until_sent: ends when the answer is sent, or will not be.
    """

    media_type = NDJSON

    def __init__(
        self,
        batch: Batch,
        parts: AsyncGenerator[tuple[range, list[bytes]], None],
        until_sent: ExitStack,
    ) -> None:
        super().__init__()
        del self.headers["Content-Length"]
        self._batch = batch
        self._parts = parts
        self._until_sent = until_sent

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002
        with self._until_sent:
            await send(
                {
                    "type": "http.response.start",
                    "status": self.status_code,
                    "headers": self.raw_headers,
                }
            )
            try:
                async with aclosing(self._parts) as parts:
                    async for part, lines in parts:
                        self._batch.done(part)
                        await self._send(lines, send)
            except ClientGone:
                return
            await send({"type": "http.response.body", "body": b"", "more_body": False})

    async def _send(self, lines: list[bytes], send: Send) -> None:
        work = self._batch.work
        work.is_held_up = True
        for piece in lines:
            await send({"type": "http.response.body", "body": piece, "more_body": True})
        work.is_held_up = False
        await asyncio.sleep(0)  # a connection that takes all at once would keep the others
