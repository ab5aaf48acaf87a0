"""The server's sockets and its own log lines; its signals are in test_signals.py."""

import logging
import signal
import socket
import threading
from contextvars import copy_context
from pathlib import Path

from asgi_correlation_id import correlation_id

from app.main import create_app
from app.server import Server, listen
from app.settings import Settings
from tests.served import wait_until


class Ids(logging.Handler):
    """Keeps the request's id that each message would be logged with."""

    def __init__(self) -> None:
        super().__init__()
        self.of: dict[str, str | None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        self.of[record.getMessage()] = correlation_id.get()


def test_the_end_is_logged_without_the_id_of_the_request_that_it_interrupts(tmp_path: Path) -> None:
    ids = Ids()
    log = logging.getLogger("app.server")
    log.addHandler(ids)
    log.setLevel(logging.INFO)
    settings = Settings(model_store=tmp_path)
    server = Server(create_app(settings), settings)
    thread = threading.Thread(target=server.run, kwargs={"sockets": listen("127.0.0.1", 0)})
    thread.start()
    try:
        wait_until(lambda: any("serves at" in message for message in ids.of))

        def interrupt() -> None:
            correlation_id.set("of-a-request")
            server.handle_exit(signal.SIGTERM, None)

        copy_context().run(interrupt)
        wait_until(lambda: "draining" in ids.of)
    finally:
        server.should_exit = True
        thread.join()
        log.removeHandler(ids)
        log.setLevel(logging.NOTSET)
    assert ids.of["draining"] is None


def test_connections_to_a_socket_that_listens_send_at_once() -> None:
    (listener,) = listen("127.0.0.1", 0)
    with listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            # What asyncio looks at before it turns Nagle's algorithm off.
            assert accepted.proto == socket.IPPROTO_TCP
