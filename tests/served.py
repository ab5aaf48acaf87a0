"""A service on a port, for tests that speak real HTTP to it."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import httpx
from starlette.types import ASGIApp

from app.launch import START_SECONDS
from app.main import create_app
from app.server import Server
from app.settings import Settings


@contextmanager
def serving(settings: Settings) -> Iterator[httpx.Client]:
    """Serve over a free port; yield a client of it."""
    app = create_app(settings)
    with running(app, settings=settings) as url, client_of(url) as client:
        yield client


def client_of(url: str) -> httpx.Client:
    """Return a client that waits for as long as a loaded machine takes."""
    return httpx.Client(base_url=url, timeout=START_SECONDS)


@contextmanager
def running(app: ASGIApp, port: int = 0, settings: Settings | None = None) -> Iterator[str]:
    """Run `app` on a port, a free one by default; yield its URL."""
    # With the protocol named, asyncio sends at once and does not wait for the client (Nagle).
    with socket.socket(proto=socket.IPPROTO_TCP) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        server = Server(app, settings or Settings())
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            while not server.started:
                time.sleep(0.01)
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join()


def wait_until_ready(client: httpx.Client) -> None:
    wait_until(lambda: client.get("/readyz").is_success)


def wait_until(condition: Callable[[], bool]) -> None:
    """Return once it holds: a test that waits is never told how fast a machine is."""
    deadline = time.monotonic() + START_SECONDS
    while not condition():
        assert time.monotonic() < deadline, "it did not come about"
        time.sleep(0.01)
