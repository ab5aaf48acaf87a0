"""A batch's answer: lines of JSON as they are done, as fast as the client takes them."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import ExitStack, aclosing

from starlette.types import Send

from app.api.sending import PartedResponse
from app.serving.batches import Batch
from app.serving.refusals import ClientGone

NDJSON = "application/x-ndjson"


class BatchResponse(PartedResponse):
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
        super().__init__(until_sent, {})
        self._batch = batch
        self._parts = parts

    async def send_body(self, send: Send) -> None:
        """Send line after line, and count what is done."""
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
