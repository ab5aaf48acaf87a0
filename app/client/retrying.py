"""A transport that comes back by itself while a service is busy, starting or away."""

from collections.abc import Awaitable, Callable

import httpx
from httpx_retries import Retry, RetryTransport

from app.client.events import EVENT_STREAM

LONGEST_WAIT_SECONDS = 10.0
MOST_RETRIES = 1000
IN_PARTS = ("application/x-ndjson", EVENT_STREAM)
"""Kinds of answers that are read as they come."""


def retrying(
    transport: httpx.BaseTransport | httpx.AsyncBaseTransport | None,
    patience_s: float,
    read_whole: Callable[[httpx.Response], Awaitable[None] | None],
) -> RetryTransport:
    """Wrap a transport so that it comes back: a request has a seed, and may be asked twice.

    An answer that takes too long is not asked for again: it would take as long once more.
    """
    retry = Retry(
        total=MOST_RETRIES,
        allowed_methods=("GET", "POST"),
        status_forcelist=(httpx.codes.TOO_MANY_REQUESTS, httpx.codes.SERVICE_UNAVAILABLE),
        retry_on_exceptions=(
            httpx.ConnectTimeout,
            httpx.NetworkError,
            httpx.RemoteProtocolError,
        ),
        backoff_factor=0.1,
        max_backoff_wait=LONGEST_WAIT_SECONDS,
        total_timeout=patience_s,
        validate_response=read_whole,
    )
    return RetryTransport(transport, retry)


def read_whole(response: httpx.Response) -> None:
    """Read the body while a connection that breaks off still leads to another attempt.

    But for what comes in parts, and is read as it comes.
    """
    if not _comes_in_parts(response):
        response.read()


async def read_whole_async(response: httpx.Response) -> None:
    """Do as `read_whole` does."""
    if not _comes_in_parts(response):
        await response.aread()


def _comes_in_parts(response: httpx.Response) -> bool:
    return bool(response.headers.get("Content-Type", "").startswith(IN_PARTS))
