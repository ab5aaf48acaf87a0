"""Server-sent events: a plan to several targets as it comes about, one event a segment.

`segment` events have a `Segment` each, then `plan` has the whole answer; or `problem` tells, as
problem+json, what ended it after the first segment. Before that, errors are answered as ever.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import ExitStack
from typing import Any

from starlette.datastructures import Headers
from starlette.types import Send

from app.api.sending import PartedResponse
from app.serving.json_parts import json_parts

EVENT_STREAM = "text/event-stream"


def accepts_events(headers: Headers) -> bool:
    """Say whether a client asks for events, by its Accept header."""
    kinds = ",".join(headers.getlist("accept")).lower().split(",")
    return any(kind.partition(";")[0].strip() == EVENT_STREAM for kind in kinds)


def as_event(kind: str, text: bytes) -> bytes:
    """Return an event with a line of data."""
    return b"event: " + kind.encode() + b"\ndata: " + text + b"\n\n"


def json_event(kind: str, value: Any) -> bytes:
    """Return an event with what `json_parts` writes."""
    return as_event(kind, b"".join(json_parts(value)))


async def stream(
    run: Callable[[Callable[[bytes], None]], Awaitable[bytes]],
    problem: Callable[[Exception], bytes],
    until_sent: ExitStack,
) -> "EventResponse":
    """Return a response with the events of some work, once there is one.

    Args:
        run: does the work; what it is given takes an event, in any thread. Returns the last event.
        problem: tells in an event what went wrong after another one was sent.
        until_sent: ends when the events are sent, or will not be; here, if there is none.

    Raises:
        Exception: what `run` raised before there was an event.
    """
    loop = asyncio.get_running_loop()
    queue: asyncio.Queue[bytes | None] = asyncio.Queue()

    def put(event: bytes) -> None:
        loop.call_soon_threadsafe(queue.put_nowait, event)

    work = asyncio.ensure_future(run(put))
    work.add_done_callback(lambda _: queue.put_nowait(None))
    first = await queue.get()
    if first is None:
        work.result()

    async def events() -> AsyncIterator[bytes]:
        event = first
        while event is not None:
            yield event
            event = await queue.get()
        try:
            last = work.result()
        except Exception as error:
            last = problem(error)
        yield last

    return EventResponse(events(), until_sent.pop_all())


class EventResponse(PartedResponse):
    """Sends events as they come; whoever makes them learns by itself that the client has gone.

    Args:
        events: each as text.
        until_sent: ends when they are sent, or will not be.
    """

    media_type = EVENT_STREAM

    def __init__(self, events: AsyncIterator[bytes], until_sent: ExitStack) -> None:
        # nginx would hold them back.
        super().__init__(until_sent, {"Cache-Control": "no-store", "X-Accel-Buffering": "no"})
        self._events = events

    async def send_body(self, send: Send) -> None:
        """Send event after event."""
        async for event in self._events:
            await send({"type": "http.response.body", "body": event, "more_body": True})
        await send({"type": "http.response.body", "body": b""})
