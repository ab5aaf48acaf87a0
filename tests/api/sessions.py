"""A control session as a test speaks it: any text out, JSON back."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from app.launch import START_SECONDS


class Session:
    """A connection; nothing is sent yet."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection

    def ask(self, message: Any) -> dict[str, Any]:
        """Send JSON, or text or bytes as they are; return the answer."""
        self.send(message)
        return self.receive()

    def send(self, message: Any) -> None:
        text = message if isinstance(message, str | bytes) else json.dumps(message)
        self.connection.send(text)

    def receive(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.connection.recv(timeout=START_SECONDS))
        return found

    def closed(self) -> tuple[int, str]:
        """Return the code and the reason with which the service closes it."""
        with pytest.raises(ConnectionClosed) as closed:
            self.connection.recv(timeout=START_SECONDS)
        assert closed.value.rcvd is not None
        return closed.value.rcvd.code, closed.value.rcvd.reason


def socket_url(client: httpx.Client) -> str:
    return str(client.base_url.copy_with(scheme="ws")).rstrip("/") + "/control"


@contextmanager
def opened(
    client: httpx.Client,
    headers: dict[str, str] | None = None,
    origin: str | None = None,
    protocols: Sequence[str] | None = None,
) -> Iterator[Session]:
    """Open a session of the service that `client` is of; a browser sends no headers."""
    with connect(
        socket_url(client),
        additional_headers=headers,
        origin=None if origin is None else Origin(origin),
        subprotocols=None if protocols is None else [Subprotocol(name) for name in protocols],
        compression=None,
        open_timeout=START_SECONDS,
    ) as connection:
        yield Session(connection)
