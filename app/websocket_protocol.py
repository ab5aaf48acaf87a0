"""How the server speaks WebSocket: uvicorn's protocol on the `websockets` library, and what it
lacks. What is said in it is the business of app/api/control_socket.py.
"""

import asyncio
import logging
from typing import Any

import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request
from websockets.server import ServerProtocol

from app.send_timeout import SendTimeout

IPV4_MAPPED = "::ffff:"
"""What a socket for both families puts before an IPv4 address."""
SWITCHING_PROTOCOLS = 101

# It would tell of every session's beginning, which the access log does.
quiet_log = logging.getLogger("uvicorn.error.websocket")
quiet_log.setLevel(logging.WARNING)


class WebSocketConfig(uvicorn.Config):
    """What the protocol is told."""

    send_timeout_s: float


class WebSocketProtocol(SendTimeout, WebSocketsSansIOProtocol):
    """Drops clients that do not read, calls them by their own addresses, and may refuse."""

    def __init__(self, config: WebSocketConfig, *args: Any, **kwargs: Any) -> None:
        super().__init__(config, *args, **kwargs)
        self.send_timeout_s = config.send_timeout_s
        self.logger = self.conn.logger = quiet_log

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if self.client:
            host, port = self.client
            self.client = host.removeprefix(IPV4_MAPPED), port

    async def send(self, message: Any) -> None:
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and self.close_sent:
            # A refusal is an answer as well; it would be logged as an error of ours.
            self.handshake_complete = True


def is_handshake(scope: Any) -> bool:
    """Say whether a request opens a WebSocket: a library that finds fault with it later hangs up.

    Args:
        scope: of an HTTP request.
    """
    target = scope["raw_path"] + (b"?" + scope["query_string"] if scope["query_string"] else b"")
    line = b"%s %s HTTP/%s" % (scope["method"].encode(), target, scope["http_version"].encode())
    fields = (name + b": " + value for name, value in scope["headers"])
    opening = ServerProtocol()
    opening.receive_data(b"\r\n".join([line, *fields, b"", b""]))
    return any(
        isinstance(event, Request) and opening.accept(event).status_code == SWITCHING_PROTOCOLS
        for event in opening.events_received()
    )
