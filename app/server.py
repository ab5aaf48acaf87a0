"""The HTTP server: uvicorn with our settings and signals, and time limits that it lacks.

h11 reads the requests. httptools would be faster by 0.2 ms, but drops the body of one that offers
an upgrade to HTTP/2, as Java's client does, and bounds neither heads nor trailers.
"""

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Callable, Coroutine
from types import FrameType

import uvicorn
from starlette.types import ASGIApp

from app.inference.verification import ModelRejected
from app.send_timeout import SendingConfig, SendTimeout
from app.serving.refusals import NotReady
from app.serving.runtime import Runtime
from app.settings import Settings

SENDING_SECONDS = 10
"""How long clients may take to read their answers once all plans are made and the service ends."""

log = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """Serves `app` on the address and with the time limits that the settings name.

    SIGTERM or SIGINT refuses new work, finishes what was taken on, and ends; a second one ends at
    once. SIGHUP loads what is new in the model store.

    It leaves logging as it is; `app.logs` is for the process that serves.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        super().__init__(_Config(app, settings))
        self._is_ending = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and listen to SIGHUP."""
        await super().startup(sockets)
        self._loop = asyncio.get_running_loop()
        if threading.current_thread() is threading.main_thread():
            self._loop.add_signal_handler(signal.SIGHUP, self._begin, self._reload)

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
            self._loop.call_soon_threadsafe(self._begin, self._drain)

    @property
    def _runtime(self) -> Runtime:
        runtime = self.lifespan.state["runtime"]
        assert isinstance(runtime, Runtime)
        return runtime

    def _begin(self, task: Callable[[], Coroutine[None, None, None]]) -> None:
        begun = self._loop.create_task(task())
        self._tasks.add(begun)
        begun.add_done_callback(self._tasks.discard)

    async def _drain(self) -> None:
        log.info("draining")
        await self._runtime.drain()
        self.should_exit = True

    async def _reload(self) -> None:
        try:
            await self._runtime.load()
        except (ModelRejected, NotReady) as error:
            log.error("the models stay as they were: %s", error)


class _Config(SendingConfig):
    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        super().__init__(
            app,
            host=settings.host,
            port=settings.port,
            http=_HeadTimeout,
            loop="asyncio",
            ws="none",
            proxy_headers=False,  # nothing here depends on who the client is
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_keep_alive=settings.idle_timeout_s,
            timeout_graceful_shutdown=SENDING_SECONDS,
        )
        self.header_timeout_s = settings.header_timeout_s
        self.send_timeout_s = settings.send_timeout_s


class _HeadTimeout(SendTimeout):
    """Closes a connection on which the head of a request takes too long.

    The time runs from the connection's start, and on one that is kept alive from the first byte
    after an answer; it does not run between requests (uvicorn's own limit does) nor while a
    request is answered.
    """

    config: _Config
    _head_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._await_head()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.cycle is None or self.cycle.response_complete:
            self._await_head()
        else:
            self._head_is_here()

    def connection_lost(self, exc: Exception | None) -> None:
        self._head_is_here()
        super().connection_lost(exc)

    def _await_head(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(
                self.config.header_timeout_s, self.transport.close
            )

    def _head_is_here(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
