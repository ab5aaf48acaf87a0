"""One log line and one count for each HTTP request and each session, whatever becomes of it."""

import logging
import re
from time import perf_counter
from typing import Any

from asgi_correlation_id import correlation_id
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.metrics import SWITCHING_PROTOCOLS, WEBSOCKET, Metrics
from app.api.middleware import HttpMiddleware
from app.api.paths import mount_path, route_path
from app.serving.admission import NONE

CLIENT_GONE = 499
"""The status that nginx gave to requests whose client hung up before the answer."""

HTTP_METHODS = {"DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT"}
PROBES = {"/livez", "/readyz", "/metrics"}
"""Asked every few seconds, for ever."""
REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,128}")

log = logging.getLogger("breakaway.access")


def is_request_id(text: str) -> bool:
    """Say whether a client's X-Request-ID can go into logs and headers as it is."""
    return REQUEST_ID.fullmatch(text) is not None


class Telemetry(HttpMiddleware):
    """Measure, count and log each request.

    What it leaves in `request.state`:

    arrived: `time.perf_counter()` when the request's head was there; deadlines count from it.
    log_fields: a dict that a handler adds to. All of it goes into the request's log line, so no
        key may be a `logging.LogRecord`'s own (`name`, `args`, ...). Some go into the metrics, too:
        `method` (a planning method's name) and `model` ("name/version"), once resolved, are labels;
        `queue_ms` is how long the plan waited, `rejected` the reason why there is none.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        super().__init__(app)
        self.metrics = metrics

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        arrived = perf_counter()
        fields: dict[str, Any] = {}
        scope["state"] = {**scope.get("state", {}), "arrived": arrived, "log_fields": fields}
        status: int | None = None

        async def observed_receive() -> Message:
            nonlocal status
            message = await receive()
            if message["type"] == "http.disconnect" and status is None:
                status = CLIENT_GONE
            return message

        async def observed_send(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start" and status is None:
                status = message["status"]
            await send(message)

        try:
            await self.app(scope, observed_receive, observed_send)
        finally:  # an exception without a status: Starlette answers 500 outside of here
            self._record(scope, fields, status or 500, perf_counter() - arrived)

    async def handle_session(self, scope: Scope, receive: Receive, send: Send) -> None:
        arrived = perf_counter()
        fields: dict[str, Any] = {}
        scope["state"] = {**scope.get("state", {}), "arrived": arrived, "log_fields": fields}
        status: int | None = None

        async def observed_receive() -> Message:
            message = await receive()
            if message["type"] == "websocket.disconnect":
                fields.setdefault("close_code", message["code"])
            return message

        async def observed_send(message: Message) -> None:
            nonlocal status
            match message["type"]:
                case "websocket.accept":
                    # Who is refused in a session's own way was refused all the same.
                    status = fields.pop("refused", SWITCHING_PROTOCOLS)
                    _identify(message)
                case "websocket.http.response.start":
                    status = message["status"]
                    _identify(message)
                case "websocket.close":
                    fields.setdefault("close_code", message["code"])
            await send(message)

        try:
            await self.app(scope, observed_receive, observed_send)
        finally:
            seconds = perf_counter() - arrived
            self.metrics.observe_session(
                route=_route(scope),
                status=status or CLIENT_GONE,
                seconds=seconds,
                controller=fields.get("method", NONE),
            )
            self._tell(scope, WEBSOCKET, fields, status or CLIENT_GONE, seconds)

    def _record(self, scope: Scope, fields: dict[str, Any], status: int, seconds: float) -> None:
        verb = scope["method"] if scope["method"] in HTTP_METHODS else "other"
        self.metrics.observe_request(
            route=_route(scope),
            http_method=verb,
            status=status,
            seconds=seconds,
            method=fields.get("method", NONE),
            model=fields.get("model", NONE),
        )
        if "queue_ms" in fields:
            self.metrics.observe_queue(fields.get("model", NONE), fields["queue_ms"] / 1e3)
        self._tell(scope, scope["method"], fields, status, seconds)

    def _tell(
        self, scope: Scope, verb: str, fields: dict[str, Any], status: int, seconds: float
    ) -> None:
        route = _route(scope)
        path = scope["path"] or "-"  # what cannot be read has none
        if "rejected" in fields:
            self.metrics.rejected(fields["rejected"], fields.get("model", NONE))
        line = {
            "request_id": correlation_id.get(),
            "route": route,
            "client": scope["client"][0] if scope.get("client") else None,
            "http_method": verb,
            "path": path,
            "status": status,
            "duration_ms": round(seconds * 1e3, 3),
        }
        log.log(
            logging.DEBUG if route in PROBES else logging.INFO,
            "%s %s %d in %.1f ms",
            verb,
            path,
            status,
            seconds * 1e3,
            extra={**fields, **line},
        )


def _identify(message: Message) -> None:
    """Put the request's id into the head of an answer to a handshake, which others leave out."""
    MutableHeaders(scope=message).append("X-Request-ID", correlation_id.get() or "")


def _route(scope: Scope) -> str:
    """Return the template of the route that matched, never a client's own text."""
    if route := scope.get("route"):
        return str(route.path)
    if "endpoint" not in scope:
        return "unmatched"
    # Starlette's own routes are not in the scope; those that FastAPI adds have no parameters.
    mounted: str = scope["root_path"].removeprefix(mount_path(scope))
    return mounted or route_path(scope)
