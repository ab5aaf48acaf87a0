"""A client that does not take what is sent to it is dropped."""

import asyncio
import logging
import socket
import struct
import sys

UNSENT_BYTES = 1 << 16
"""The kernel takes no more than this and what is under way to the client."""
TCP_NOTSENT_LOWAT = 25
"""Linux's number; Python has a name for it from 3.12 on."""
RESET = struct.pack("ii", 1, 0)
"""For SO_LINGER: what the kernel still holds for the client is thrown away, too."""

log = logging.getLogger(__name__)


class SendTimeout(asyncio.Protocol):
    """Drops a client that leaves lying what is sent to it; stands before one of uvicorn's classes.

    The time runs while the transport holds bytes that the kernel does not take. Whoever sends waits
    meanwhile, so these are one part of an answer at most: a slow client has the time anew for each
    part. Without a limit of its own the kernel would hold megabytes, and the next part would have
    to wait until most of them are taken.
    """

    send_timeout_s: float
    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    _send_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=0)
        if sys.platform == "linux":
            connection = transport.get_extra_info("socket")
            connection.setsockopt(socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, UNSENT_BYTES)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._send_timer = self.loop.call_later(self.send_timeout_s, self._drop)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._stop_send_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_send_timer()
        super().connection_lost(exc)

    def _stop_send_timer(self) -> None:
        if self._send_timer is not None:
            self._send_timer.cancel()
            self._send_timer = None

    def _drop(self) -> None:
        log.info("dropped a client that took nothing for %g s", self.send_timeout_s)
        connection = self.transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        self.transport.abort()
