"""A service in a process of its own."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import httpx

from tests.served import COLD_START_SECONDS, free_port

LONGEST_END_SECONDS = 60


class NotServing(Exception):
    """The service ended, or did not become ready."""


class ServerProcess(NamedTuple):
    """A service that was started."""

    url: str
    process: subprocess.Popen[bytes]
    log: Path

    def end(self) -> float:
        """Tell it to finish what it took on and end, or make it; return how long that took, s."""
        started = time.perf_counter()
        self.process.terminate()
        try:
            self.process.wait(LONGEST_END_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
        return time.perf_counter() - started


@contextmanager
def server_process(store: Path, log: Path, module: str = "app") -> Iterator[ServerProcess]:
    """Serve `store` on a free port with `python -m <module> serve`; ends with the context.

    Args:
        store: the model store.
        log: what the service says is written here.
        module: what to run.

    Raises:
        NotServing: it does not become ready.
    """
    port = str(free_port())
    command = [sys.executable, "-m", module, "serve", "--port", port, "--model-store", str(store)]
    with log.open("wb") as out, subprocess.Popen(command, stdout=out, stderr=out) as process:
        server = ServerProcess(f"http://127.0.0.1:{port}", process, log)
        try:
            _wait_until_ready(server)
            yield server
        finally:
            server.end()


def _wait_until_ready(server: ServerProcess) -> None:
    deadline = time.monotonic() + COLD_START_SECONDS
    while not _is_ready(server.url):
        if server.process.poll() is not None or time.monotonic() > deadline:
            raise NotServing(server.log.read_text())
        time.sleep(0.1)


def _is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz").is_success
    except httpx.TransportError:
        return False
