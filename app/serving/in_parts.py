"""Something done in parts, a few of them at once."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator
from typing import TypeVar

P = TypeVar("P")
T = TypeVar("T")


async def as_done(
    parts: Iterator[P], do: Callable[[P], Awaitable[T]], at_once: int, stop: Callable[[], None]
) -> AsyncGenerator[tuple[P, T], None]:
    """Yield each part with what came of it, in whatever order they get done.

    Args:
        parts: asked for the next one when it can be begun.
        do: does a part.
        at_once: how many parts are under way, or wait to be taken.
        stop: called when there are no more, or nobody takes them; parts under way end soon then.
    """
    under_way: dict[asyncio.Future[T], P] = {}

    def begin() -> None:
        while len(under_way) < at_once and (part := next(parts, None)) is not None:
            under_way[asyncio.ensure_future(do(part))] = part

    try:
        begin()
        while under_way:
            done, _ = await asyncio.wait(under_way, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                part = under_way.pop(task)
                yield part, task.result()
                begin()
    finally:
        stop()
        await asyncio.gather(*under_way, return_exceptions=True)
