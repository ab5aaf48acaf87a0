"""A service on a free port, for tests that speak real HTTP to it."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import uvicorn

from app.main import create_app
from app.settings import Settings

COLD_START_SECONDS = 300
"""The first start compiles every kernel: a minute on two free cores, more on busy ones."""


@contextmanager
def serving(settings: Settings) -> Iterator[httpx.Client]:
    """Serve over a free port; yield a client of it."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        config = uvicorn.Config(create_app(settings), log_level="warning")
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60) as client:
                while not server.started:
                    time.sleep(0.01)
                yield client
        finally:
            server.should_exit = True
            thread.join()


def wait_until_ready(client: httpx.Client) -> None:
    deadline = time.monotonic() + COLD_START_SECONDS
    while not client.get("/readyz").is_success:
        assert time.monotonic() < deadline, "the service did not become ready"
        time.sleep(0.05)
