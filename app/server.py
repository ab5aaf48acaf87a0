"""The HTTP server: uvicorn with our settings, signals and protocol."""

import asyncio
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Coroutine
from contextvars import Context
from types import FrameType

import uvicorn
from starlette.types import ASGIApp

from app.api.control_socket import PATH
from app.http_protocol import Protocol, ProtocolConfig
from app.inference.verification import ModelRejected
from app.serving.refusals import NotReady
from app.serving.runtime import Runtime
from app.settings import Settings
from app.websocket_protocol import WebSocketProtocol

FAILED_SECONDS = 5
"""How long a service that could not start tells so, before it ends."""
SENDING_SECONDS = 10
"""How long clients may take to read their answers once all plans are made and the service ends."""

SWITCH_SECONDS = 5e-4
"""How long a thread may keep the interpreter from the event loop; Python's own number, ten times
that, is as much as a controlled machine has for a whole step, and a step asks for it several times.
"""

BACKLOG = 2048
"""Connections that wait to be accepted; uvicorn's own number."""

log = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """Serves `app` on the address and with the time limits that the settings name.

    SIGTERM or SIGINT refuses new work, finishes what was taken on, and ends; a second one ends at
    once. SIGHUP loads what is new in the model store.

    It leaves logging as it is; `app.logs` is for the process that serves.

    Args:
        app: what is served.
        settings: where, and the time limits.
        when_ready: told the URL once plans can be made.
    """

    def __init__(
        self, app: ASGIApp, settings: Settings, when_ready: Callable[[str], None] | None = None
    ) -> None:
        super().__init__(_Config(app, settings))
        self._when_ready = when_ready
        self.failed = False
        """Whether the service could not start."""
        self._is_ending = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and listen to SIGHUP."""
        sys.setswitchinterval(SWITCH_SECONDS)
        await super().startup(sockets)
        self._loop = asyncio.get_running_loop()
        if threading.current_thread() is threading.main_thread():
            self._loop.add_signal_handler(signal.SIGHUP, self._begin, self._reload)
        self._begin(self._watch_start)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End in good order at the first signal, at once at the second."""
        if not self.started:
            super().handle_exit(sig, frame)
            return
        self._captured_signals.append(sig)
        if self._is_ending:
            self._runtime.abort()
            self.should_exit = self.force_exit = True
        else:
            self._is_ending = True
            # The signal may interrupt a request, whose id is not for the lines that follow.
            self._loop.call_soon_threadsafe(self._begin, self._drain, context=Context())

    @property
    def _runtime(self) -> Runtime:
        runtime = self.lifespan.state["runtime"]
        assert isinstance(runtime, Runtime)
        return runtime

    def _begin(self, task: Callable[[], Coroutine[None, None, None]]) -> None:
        begun = self._loop.create_task(task())
        self._tasks.add(begun)
        begun.add_done_callback(self._tasks.discard)

    async def _watch_start(self) -> None:
        await self._runtime.started.wait()
        if self._runtime.failed:
            self.failed = True
            await asyncio.sleep(FAILED_SECONDS)
            self.should_exit = True
        elif listeners := self.servers[0].sockets:  # none, once it ends
            host, port = listeners[0].getsockname()[:2]
            url = f"http://{f'[{host}]' if ':' in host else host}:{port}"
            log.info("Breakaway serves at %s, its documentation at %s/docs", url, url)
            if self._when_ready:
                self._when_ready(f"{url}/")

    async def _drain(self) -> None:
        log.info("draining")
        await self._runtime.drain()
        self.should_exit = True

    async def _reload(self) -> None:
        try:
            await self._runtime.load()
        except (ModelRejected, NotReady) as error:
            log.error("the models stay as they were: %s", error)


def listen(host: str, port: int) -> list[socket.socket]:
    """Return sockets that listen on every address of `host`; `::` takes IPv4 as well.

    Raises:
        OSError: nothing can listen there; it says where and why.
    """
    try:
        addresses = {
            (family, address[:2])
            for family, _, _, _, address in socket.getaddrinfo(
                host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )
        }
        listening = [
            socket.create_server(
                address,
                family=family,
                backlog=BACKLOG,
                dualstack_ipv6=host == "::" and socket.has_dualstack_ipv6(),
            )
            for family, address in sorted(addresses)
        ]
    except OSError as error:
        # Not its text, which is long; and the resolver's numbers are none of the system's.
        why = (
            error.strerror if isinstance(error, socket.gaierror) else os.strerror(error.errno or 0)
        )
        raise OSError(f"cannot listen on {host}, port {port}: {why}") from error
    # Taken up anew they know that they are TCP; asyncio would leave Nagle's algorithm on, and with
    # it 40 ms an answer, for one that does not.
    return [socket.socket(fileno=listener.detach()) for listener in listening]


class _Config(ProtocolConfig):
    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        super().__init__(
            app,
            host=settings.host,
            port=settings.port,
            http=Protocol,
            loop="asyncio",
            ws=WebSocketProtocol,
            ws_max_size=settings.max_body_bytes,
            ws_per_message_deflate=False,
            forwarded_allow_ips=list(settings.trusted_proxies),
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_keep_alive=settings.idle_timeout_s,
            timeout_graceful_shutdown=SENDING_SECONDS,
        )
        self.header_timeout_s = settings.header_timeout_s
        self.send_timeout_s = settings.send_timeout_s
        self.session_paths = frozenset({PATH, settings.root_path + PATH})
