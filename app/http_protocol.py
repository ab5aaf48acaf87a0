"""How the server reads HTTP from a connection: uvicorn's protocol for h11, and what it lacks.

h11 reads the requests. httptools would be faster by 0.2 ms, but drops the body of one that offers
an upgrade to HTTP/2, as Java's client does, and bounds neither heads nor trailers.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import h11
from asgi_correlation_id import CorrelationIdMiddleware
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from app.api.errors import MalformedHttp, answer_malformed_http
from app.api.telemetry import Telemetry
from app.send_timeout import SendTimeout
from app.websocket_protocol import IPV4_MAPPED, WebSocketConfig, is_handshake


class ProtocolConfig(WebSocketConfig):
    """What the protocol is told."""

    header_timeout_s: float
    session_paths: frozenset[str]
    """Where a WebSocket may be asked for."""


class Protocol(SendTimeout, H11Protocol):
    """Bounds the time for a request's head, and answers what is no HTTP like any other request.

    The time runs from the connection's start, and on one that is kept alive from the first byte
    after an answer; it does not run between requests (uvicorn's own limit does) nor while a
    request is answered. A connection that becomes a WebSocket goes over to another protocol; every
    request for one that cannot be is answered as a request.
    """

    config: ProtocolConfig
    _head_timer: asyncio.TimerHandle | None = None
    _error: MalformedHttp | None = None
    _is_handed_over = False

    def __init__(self, config: ProtocolConfig, *args: Any, **kwargs: Any) -> None:
        super().__init__(config, *args, **kwargs)
        self.send_timeout_s = config.send_timeout_s
        self.conn = _Connection(self._refuse)
        self._application: ASGIApp = self.app
        self.app = self._run

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if self.client:
            host, port = self.client
            self.client = host.removeprefix(IPV4_MAPPED), port
        self._await_head()

    def data_received(self, data: bytes) -> None:
        if self._error is not None:
            return
        super().data_received(data)
        if self._is_handed_over:
            self._head_is_here()
            self._stop_send_timer()
        elif self.cycle is None or self.cycle.response_complete:
            self._await_head()
        else:
            self._head_is_here()

    def connection_lost(self, exc: Exception | None) -> None:
        self._head_is_here()
        super().connection_lost(exc)

    def _should_upgrade(self) -> bool:
        return (
            super()._should_upgrade()
            and self.scope["path"] in self.config.session_paths
            and is_handshake(self.scope)
        )

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        self._is_handed_over = True
        super().handle_websocket_upgrade(event)

    def _unsupported_upgrade_warning(self) -> None:
        """Say nothing: uvicorn would have the operator install something."""

    def _await_head(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(
                self.config.header_timeout_s, self.transport.close
            )

    def _head_is_here(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    async def _run(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def receive_well_formed() -> Message:
            message = await receive()
            if self._error is not None and message["type"] == "http.request":
                raise self._error
            return message

        await self._application(scope, receive_well_formed, send)

    def _refuse(self, error: h11.RemoteProtocolError) -> None:
        """See to it that the client is told, and hears no more of this connection."""
        reason = str(error).partition(": bytearray(")[0]  # the client's own bytes follow
        self._error = MalformedHttp(error.error_status_hint, reason)
        if self.conn.our_state is h11.IDLE:
            self._answer_head(self._error)
        elif not self.cycle.response_complete:  # it is the body: whoever reads it meets the error
            self.cycle.keep_alive = False
            self.cycle.message_event.set()
        else:
            self.transport.close()

    def _answer_head(self, error: MalformedHttp) -> None:
        """Answer with an id, a log line and a count, though there is no request to speak of."""

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            response = await answer_malformed_http(Request(scope), error)
            await response(scope, receive, send)

        self.cycle = RequestResponseCycle(
            scope={
                "type": "http",
                "asgi": {"version": self.asgi_version, "spec_version": "2.3"},
                "http_version": "1.1",
                "server": self.server,
                "client": self.client,
                "scheme": self.scheme or "http",
                "method": "-",
                "root_path": "",
                "path": "",
                "raw_path": b"",
                "query_string": b"",
                "headers": [],
                "state": self.app_state.copy(),
            },
            conn=self.conn,
            transport=self.transport,
            flow=self.flow,
            logger=self.logger,
            access_logger=self.access_logger,
            access_log=False,
            default_headers=self.server_state.default_headers,
            message_event=asyncio.Event(),
            on_response=self.on_response_complete,
        )
        self.cycle.keep_alive = False
        app = CorrelationIdMiddleware(Telemetry(answer, self.app_state["metrics"]))
        task = self.loop.create_task(self.cycle.run_asgi(app))  # type: ignore[arg-type]
        task.add_done_callback(self.tasks.discard)
        self.tasks.add(task)


class _Connection(h11.Connection):
    """A server's side of a connection, which hands errors of the other side to `refuse`."""

    def __init__(self, refuse: Callable[[h11.RemoteProtocolError], None]) -> None:
        super().__init__(h11.SERVER)
        self._refuse = refuse
        self._has_failed = False

    def next_event(self) -> Any:
        if self._has_failed:
            return h11.NEED_DATA
        try:
            return super().next_event()
        except h11.RemoteProtocolError as error:
            self._has_failed = True
            self._refuse(error)
            return h11.NEED_DATA
