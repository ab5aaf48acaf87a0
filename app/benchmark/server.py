"""A service in a process of its own, for the benchmarks that ask it over HTTP."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter, sleep

import httpx
import psutil

START_TIMEOUT_S = 60


@dataclass(frozen=True, slots=True)
class Served:
    """A running service."""

    client: httpx.Client
    process: "subprocess.Popen[bytes]"
    start_seconds: float
    """From its process's start until it was ready."""

    @property
    def memory_mib(self) -> float:
        """What is resident of it now."""
        return float(psutil.Process(self.process.pid).memory_info().rss / 2**20)


@contextmanager
def served(*module: str) -> Iterator[Served]:
    """Run `python -m` `module` with a port until the context ends.

    Raises:
        TimeoutError: it does not become ready.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    started = perf_counter()
    command = [sys.executable, "-m", *module, "--port", str(port), "--log-level", "error"]
    with subprocess.Popen(command) as process:
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60) as client:
                _wait_until_ready(client, process)
                yield Served(client, process, perf_counter() - started)
        finally:
            process.terminate()


def _wait_until_ready(client: httpx.Client, process: "subprocess.Popen[bytes]") -> None:
    deadline = perf_counter() + START_TIMEOUT_S
    while True:
        try:
            if client.get("/readyz").is_success:
                return
        except httpx.TransportError:
            pass
        if process.poll() is not None or perf_counter() > deadline:
            raise TimeoutError("the service did not become ready")
        sleep(0.05)
