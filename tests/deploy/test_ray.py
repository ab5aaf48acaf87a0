"""The service within Ray Serve: what its proxy does otherwise than a server."""

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

pytest.importorskip("ray")

from starlette.types import Message, Receive, Scope, Send

from app.deploy.ray import WithinServe

SCOPE: dict[str, Any] = {"type": "http", "state": {}}
Messages = list[MutableMapping[str, Any]]


async def _never() -> Message:
    await asyncio.Event().wait()
    raise AssertionError


async def _lost(_: Message) -> None: ...


def test_a_request_that_is_cancelled_is_one_whose_client_has_gone() -> None:
    heard: Messages = []
    begun = asyncio.Event()

    async def service(_: Scope, receive: Receive, __: Send) -> None:
        begun.set()
        heard.append(await receive())

    async def cancel() -> None:
        request = asyncio.ensure_future(WithinServe(service)(SCOPE, _never, _lost))
        await begun.wait()
        request.cancel()
        with pytest.raises(asyncio.CancelledError):
            await request

    asyncio.run(cancel())
    assert heard == [{"type": "http.disconnect"}]


def test_ids_are_left_to_the_proxy() -> None:
    sent: Messages = []

    async def service(_: Scope, __: Receive, send: Send) -> None:
        headers = [(b"x-request-id", b"1"), (b"retry-after", b"2")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})

    async def keep(message: Message) -> None:
        sent.append(message)

    asyncio.run(WithinServe(service)(SCOPE, _never, keep))
    assert sent[0]["headers"] == [(b"retry-after", b"2")]
