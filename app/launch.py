"""A service in a process of its own, for whoever asks one over HTTP: benchmarks, load and tests."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter, sleep
from typing import IO

import httpx

START_SECONDS = 300
"""The first start on a machine compiles every kernel: a minute on two free cores."""
END_SECONDS = 60
"""How long a service may take to finish what it took on."""
POLL_SECONDS = 0.05


class NotServing(Exception):
    """The service ended, or did not become ready."""


@dataclass(frozen=True, slots=True)
class ServerProcess:
    """A service that was started and became ready."""

    url: str
    process: "subprocess.Popen[bytes]"
    start_seconds: float
    """From its process's start until it was ready."""

    def end(self) -> float:
        """Tell it to finish what it took on and end, or make it; return how long that took, s."""
        started = perf_counter()
        _end(self.process)
        return perf_counter() - started


def free_port() -> int:
    """Return a port of this machine on which nothing listens."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


@contextmanager
def launch(
    *arguments: str, port: int | None = None, output: IO[bytes] | None = None
) -> Iterator[ServerProcess]:
    """Run `python -m` with `arguments` and a port; the process ends with the context.

    Args:
        arguments: a module that serves, and its flags.
        port: where it listens; by default a free one.
        output: takes what the service prints and logs; by default it goes where this process's own
            goes.

    Raises:
        NotServing: it does not become ready.
    """
    port = port or free_port()
    url = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", *arguments, "--port", str(port)]
    started = perf_counter()
    with subprocess.Popen(command, stdout=output, stderr=output) as process:
        try:
            _wait_until_ready(url, process, started + START_SECONDS)
            yield ServerProcess(url, process, perf_counter() - started)
        finally:
            _end(process)


def _wait_until_ready(url: str, process: "subprocess.Popen[bytes]", deadline: float) -> None:
    while not _is_ready(url):
        if process.poll() is not None or perf_counter() > deadline:
            raise NotServing(f"the service at {url} did not become ready")
        sleep(POLL_SECONDS)


def _is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz").is_success
    except httpx.TransportError:
        return False


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.terminate()
    try:
        process.wait(END_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
