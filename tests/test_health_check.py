"""The image's health check, as Docker runs it."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from app.launch import START_SECONDS
from app.settings import Settings
from tests.served import serving, wait_until_ready
from tests.test_environment import INJECTED


def check(**variables: str) -> int:
    command = [sys.executable, "-m", "app.health_check"]
    return subprocess.run(command, env=os.environ | variables, check=False).returncode


def port_of(client: httpx.Client) -> dict[str, str]:
    return {"BREAKAWAY_PORT": str(client.base_url.port)}


def test_a_service_is_healthy_once_it_is_ready(tmp_path: Path) -> None:
    with serving(Settings(model_store=tmp_path, root_path="/planner")) as client:
        wait_until_ready(client)
        assert check(**port_of(client)) == 0
        everywhere = {"BREAKAWAY_HOST": "0.0.0.0"}  # as the image has it
        assert check(**INJECTED | everywhere | port_of(client)) == 0
    assert check(**port_of(client)) == 1


def test_a_service_that_cannot_start_is_not_healthy(model_store: Path) -> None:
    with serving(Settings(model_store=model_store / "nowhere")) as client:
        assert check(**port_of(client)) == 1


def test_an_injected_port_stands_for_the_usual_one() -> None:
    command = [sys.executable, "-m", "app.health_check"]
    try:
        listener = socket.create_server(("127.0.0.1", 8000))
    except OSError:
        pytest.skip("something else is at the usual port")
    with listener, subprocess.Popen(command, env=os.environ | INJECTED) as process:
        listener.settimeout(START_SECONDS)
        connection, _ = listener.accept()
        with connection:
            assert connection.recv(65536).startswith(b"GET /readyz ")
            connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n")
        assert process.wait() == 0
