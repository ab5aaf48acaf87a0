"""Starting a service in a process of its own, with stand-ins that are quicker than the service."""

import signal
import sys
import textwrap
from pathlib import Path

import httpx
import pytest

from app.launch import NotServing, free_port, launch

SERVER = """
    import argparse, http.server

    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int)
    parser.add_argument("--status", type=int, default=200)
    options = parser.parse_args()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(options.status)
            self.end_headers()

    print("serving", flush=True)
    http.server.HTTPServer(("127.0.0.1", options.port), Handler).serve_forever()
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "stand_in.py").write_text(textwrap.dedent(SERVER))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "stand_in"


def test_a_service_runs_until_the_context_ends_and_its_output_is_kept(
    module: str, tmp_path: Path
) -> None:
    with (tmp_path / "log").open("wb") as output, launch(module, output=output) as server:
        assert httpx.get(f"{server.url}/readyz").is_success
        assert server.process.poll() is None
        assert server.start_seconds > 0

    assert server.process.poll() is not None
    assert "serving" in (tmp_path / "log").read_text()


def test_a_service_can_be_ended_before_the_context_does(module: str) -> None:
    with launch(module) as server:
        assert server.end() > 0
        assert server.process.poll() == -signal.SIGTERM


def test_it_listens_where_it_is_told(module: str) -> None:
    port = free_port()

    with launch(module, port=port) as server:
        assert server.url == f"http://127.0.0.1:{port}"


def test_a_process_that_ends_before_it_is_ready_is_no_service() -> None:
    with pytest.raises(NotServing), launch("no_such_module_anywhere"):
        pass


def test_a_service_that_does_not_become_ready_in_time_is_ended(
    module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["app.launch"], "START_SECONDS", 1)

    with pytest.raises(NotServing), launch(module, "--status", "503"):
        pass
