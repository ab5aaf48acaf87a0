"""The start of the server process: with no kernels yet, told to end meanwhile, and failing."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from app.launch import START_SECONDS, free_port
from tests.served import wait_until

REQUEST = {"initial_state": [0, 0], "target_state": [0.3, 0], "num_candidates": 4, "seed": 1}
STEP = {"state": [0, 0], "target_state": [0.3, 0]}
ODD: list[dict[str, Any]] = [
    {"method": method, "horizon": horizon, "refine": {"iterations": 3}, "objective": objective}
    for method in ("uniform", "cem", "mppi", "icem")
    for horizon in (1, 10, 64)
    for objective in ("terminal_error", "control_energy", "stuck_steps")
]
"""Nobody waits for a kernel because a plan arrives late, or not at all."""
FAILING = """
import sys
import app.serving.local_runtime
def warm_up(): raise MemoryError("no room for kernels")
app.serving.local_runtime.warm_up = warm_up
from app.cli import breakaway
breakaway(sys.argv[1:])
"""


class Started:
    """A server process, ready or not."""

    def __init__(self, process: "subprocess.Popen[bytes]", port: int, log: Path) -> None:
        self.process = process
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=START_SECONDS)
        self._log = log

    @property
    def messages(self) -> list[str]:
        return [json.loads(line)["message"] for line in self._log.read_text().splitlines()]

    def readiness(self) -> httpx.Response | None:
        """Return what `/readyz` answers; None where nobody does."""
        try:
            return self.client.get("/readyz")
        except httpx.TransportError:
            return None

    def is_ready(self) -> bool:
        assert self.process.poll() is None, self._log.read_text()
        answer = self.readiness()
        return answer is not None and answer.is_success


@contextmanager
def starting(
    store: Path,
    log: Path,
    *arguments: str,
    command: tuple[str, ...] = ("-m", "app"),
    port: int | None = None,
    kernels_in: Path | None = None,
) -> Iterator[Started]:
    """Start a server; its kernels are this test run's, unless a folder is named."""
    port = port or free_port()
    variables = {"NUMBA_CACHE_DIR": str(kernels_in)} if kernels_in else {}
    serve = ["serve", "--port", str(port), "--model-store", str(store), *arguments]
    with (
        log.open("w") as output,
        subprocess.Popen(
            [sys.executable, *command, *serve], env=os.environ | variables, stderr=output
        ) as process,
    ):
        started = Started(process, port, log)
        try:
            yield started
        finally:
            process.kill()
            started.client.close()


def kernels(folder: Path) -> dict[Path, int]:
    return {file: file.stat().st_mtime_ns for file in folder.rglob("*.kernel")}


def detail(server: Started) -> str:
    answer = server.readiness()
    return "" if answer is None else str(answer.json().get("detail", ""))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


def test_a_first_start_that_is_killed_goes_on_where_it_was(
    model_store: Path, tmp_path: Path, log: Path
) -> None:
    folder = tmp_path / "kernels"
    with starting(model_store, log, kernels_in=folder) as first:
        wait_until(lambda: len(kernels(folder)) > 5)
        assert "compiling kernels, once on this machine: refinement, " in detail(first)
    kept = kernels(folder)

    with starting(model_store, log, kernels_in=folder) as second:
        wait_until(second.is_ready)
        answer = second.client.post("/plan", json=REQUEST)
        early = second.client.post("/control", json=STEP)
        wait_until(lambda: second.client.post("/control", json=STEP).is_success)
        wait_until(lambda: "the models run compiled" in second.messages)
        again = second.client.post("/plan", json=REQUEST)
        compiled = kernels(folder)
        for odd in ODD:
            assert second.client.post("/plan", json=REQUEST | odd).is_success
        assert kernels(folder) == compiled

    assert early.status_code == 503  # plans do not wait for the kernels of closed loops
    assert "compiles kernels" in early.json()["detail"]
    assert len(kept) > 5
    assert kernels(folder).items() >= kept.items()
    assert again.json()["controls"] == pytest.approx(answer.json()["controls"], abs=1e-4)


@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGINT])
def test_told_to_end_it_does_not_wait_for_kernels(
    model_store: Path, tmp_path: Path, log: Path, sign: signal.Signals
) -> None:
    folder = tmp_path / "kernels"
    with starting(model_store, log, kernels_in=folder) as server:
        wait_until(lambda: len(kernels(folder)) > 0)
        children = psutil.Process(server.process.pid).children()
        server.process.send_signal(sign)
        assert server.process.wait(START_SECONDS) in (0, -sign)

        assert children
        assert not any(child.is_running() for child in children)
        assert not list(folder.rglob("*.part"))
        assert "ended before it was ready" in server.messages


def test_a_start_that_fails_says_why_and_ends(model_store: Path, log: Path) -> None:
    with starting(model_store, log, command=("-c", FAILING)) as server:
        wait_until(lambda: "could not start" in detail(server))
        assert "MemoryError: no room for kernels" in detail(server)
        assert server.process.wait(START_SECONDS) == 1
        assert any("MemoryError: no room for kernels" in message for message in server.messages)


def test_a_port_that_is_taken_is_said_before_anything_is_loaded(
    model_store: Path, tmp_path: Path, log: Path
) -> None:
    folder = tmp_path / "kernels"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with starting(model_store, log, port=port, kernels_in=folder) as server:
            assert server.process.wait(START_SECONDS) == 1
    said = f"cannot listen on 127.0.0.1, port {port}: Address already in use"
    assert log.read_text().strip() == said
    assert not kernels(folder)


def test_it_listens_to_both_families(model_store: Path, log: Path) -> None:
    with starting(model_store, log, "--host", "::") as server:
        wait_until(lambda: server.readiness() is not None)
        port = server.client.base_url.port
        assert httpx.get(f"http://[::1]:{port}/livez").is_success
        assert httpx.get(f"http://127.0.0.1:{port}/livez").is_success
