"""Serving from the command line: what it refuses to serve with, and how it ends."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from app.launch import START_SECONDS, free_port
from tests.cli.command import invoke
from tests.served import wait_until


def test_a_tampered_model_is_not_served(tampered_store: Path) -> None:
    done = invoke("serve", BREAKAWAY_MODEL_STORE=str(tampered_store))
    assert done.exit_code == 1
    assert "sha256" in done.stderr


def test_a_missing_store_is_said() -> None:
    done = invoke("serve", "--model-store", "nowhere")
    assert done.exit_code == 1
    assert "nowhere is not a directory" in done.stderr


def test_a_bad_setting_is_said_by_its_option() -> None:
    done = invoke("serve", "--port", "100000")
    assert done.exit_code == 1
    assert done.stderr == "--port: Input should be less than or equal to 65535\n"


def test_a_bad_setting_of_the_environment_is_said_by_its_variable() -> None:
    done = invoke("serve", BREAKAWAY_PORT="100000")
    assert done.exit_code == 1
    assert done.stderr == "BREAKAWAY_PORT: Input should be less than or equal to 65535\n"


@pytest.mark.parametrize(
    ("file", "complaint"), [("nowhere", "cannot read"), ("keys", "holds no key")]
)
def test_keys_that_cannot_be_used_are_said(
    tmp_path: Path, model_store: Path, file: str, complaint: str
) -> None:
    (tmp_path / "keys").touch()
    options = ("--model-store", str(model_store), "--api-keys-file", str(tmp_path / file))
    done = invoke("serve", *options)
    assert done.exit_code == 1
    assert complaint in done.stderr
    assert str(tmp_path / file) in done.stderr


def test_it_serves_shows_its_page_and_ends_on_sigterm(model_store: Path, tmp_path: Path) -> None:
    port = free_port()
    browser, shown = tmp_path / "browser", tmp_path / "shown"
    browser.write_text(f'#!/bin/sh\necho "$1" > {shown}\n')
    browser.chmod(0o755)
    command = [sys.executable, "-m", "app", "serve", "--open", "--port", str(port)]
    environment = os.environ | {
        "BREAKAWAY_MODEL_STORE": str(model_store),
        "BROWSER": f"{browser} %s",
    }
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=log) as server,
    ):
        try:
            deadline = time.monotonic() + START_SECONDS
            while not _is_ready(port):
                assert time.monotonic() < deadline
                assert server.poll() is None
                time.sleep(0.1)
            body = {"initial_state": [0, 0], "target_state": [0.2, 0], "num_candidates": 2}
            answer = httpx.post(f"http://127.0.0.1:{port}/plan", json=body, timeout=START_SECONDS)
            assert answer.status_code == 200
            assert answer.json()["model"]["name"] == "tiny"
            wait_until(lambda: shown.exists() and bool(shown.read_text()))
            assert shown.read_text() == f"http://127.0.0.1:{port}/\n"
        finally:
            server.send_signal(signal.SIGTERM)
        assert server.wait(START_SECONDS) in (0, -signal.SIGTERM)
    lines = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    (planned,) = [line for line in lines if line.get("path") == "/plan"]
    assert planned["logger"] == "breakaway.access"
    assert planned["status"] == 200


def _is_ready(port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{port}/readyz").is_success
    except httpx.TransportError:
        return False
