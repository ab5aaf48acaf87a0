"""The `breakaway` command, as a user runs it: another process, another directory."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from app.settings import SHIPPED_MODELS
from tests.serving import COLD_START_SECONDS


def breakaway(
    *arguments: str, cwd: Path, store: Path | None = None
) -> subprocess.CompletedProcess[str]:
    environment = os.environ | ({"BREAKAWAY_MODEL_STORE": str(store)} if store else {})
    return subprocess.run(
        [sys.executable, "-m", "app", *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=COLD_START_SECONDS,
    )


def test_plan_prints_and_writes_a_plan_and_its_picture(model_store: Path, tmp_path: Path) -> None:
    options = ("--seed", "7", "-k", "4", "--json", "plan.json", "--picture", "plan.png")
    done = breakaway("plan", "--to", "-0.2", "0", *options, cwd=tmp_path, store=model_store)
    assert done.returncode == 0, done.stderr
    written = json.loads((tmp_path / "plan.json").read_text())
    assert written["seed"] == 7
    assert len(written["controls"]) == 64
    assert f"{written['terminal_error']:.6f}" in done.stdout
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "nan", "0"), "target_state"),
        (("--to", "0.2", "0", "--method", "annealing"), "annealing"),
        (("--to", "0.2", "0", "--method", '{"name": '), "JSON"),
        (("--to", "0.2", "0", "--model", "nope"), "no model 'nope'"),
        (("--to", "0.2", "0", "-k", "1000000"), "at most 4096"),
        (("--to", "0.2", "0", "--method", "cem", "--picture", "plan.nope"), "nope"),
        (("--to", "0.2", "0", "--method", "cem", "--json", "no/such/folder.json"), "folder.json"),
    ],
)
def test_a_bad_plan_is_refused_without_a_traceback(
    model_store: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = breakaway("plan", *arguments, cwd=tmp_path, store=model_store)
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_models_lists_the_shipped_models_from_any_directory(tmp_path: Path) -> None:
    done = breakaway("models", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for manifest in SHIPPED_MODELS.glob("*/*/manifest.json"):
        assert manifest.parent.parent.name in done.stdout


def test_a_tampered_model_is_named_and_not_served(model_store: Path, tmp_path: Path) -> None:
    shutil.copytree(model_store, tmp_path / "store")
    checkpoint = tmp_path / "store" / "tiny" / "1" / "unet.pt"
    checkpoint.write_bytes(b"x" + checkpoint.read_bytes()[1:])
    for command in ("models", "serve"):
        done = breakaway(command, cwd=tmp_path, store=tmp_path / "store")
        assert done.returncode == 1
        assert "sha256" in done.stderr
        assert "Traceback" not in done.stderr


def test_a_missing_store_is_said(tmp_path: Path) -> None:
    done = breakaway("serve", "--model-store", "nowhere", cwd=tmp_path)
    assert done.returncode == 1
    assert "nowhere is not a directory" in done.stderr


def test_a_bad_setting_is_said(tmp_path: Path) -> None:
    done = breakaway("serve", "--port", "100000", cwd=tmp_path)
    assert done.returncode == 1
    assert "port" in done.stderr


def test_serve_serves_and_ends_on_sigterm(model_store: Path, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "app", "serve", "--port", str(port)]
    environment = os.environ | {"BREAKAWAY_MODEL_STORE": str(model_store)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment) as server:
        try:
            deadline = time.monotonic() + COLD_START_SECONDS
            while not _is_ready(port):
                assert time.monotonic() < deadline
                assert server.poll() is None
                time.sleep(0.1)
            body = {"initial_state": [0, 0], "target_state": [0.2, 0], "num_candidates": 2}
            answer = httpx.post(f"http://127.0.0.1:{port}/plan", json=body, timeout=60)
            assert answer.status_code == 200
            assert answer.json()["model"]["name"] == "tiny"
        finally:
            server.send_signal(signal.SIGTERM)
        assert server.wait(timeout=30) in (0, -signal.SIGTERM)


def _is_ready(port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{port}/readyz").is_success
    except httpx.TransportError:
        return False


def test_evaluate_compares_with_the_paper(model_store: Path, tmp_path: Path) -> None:
    options = ("--sequences", "2", "--runs", "1", "-k", "16", "--method", "dataset_prior")
    done = breakaway("evaluate", "multistep-random", *options, cwd=tmp_path, store=model_store)
    assert done.returncode == 0, done.stderr
    row = next(line for line in done.stdout.splitlines() if "`dataset_prior`" in line)
    assert "(0.4)" in row
    assert "(69.9)" in row


def test_evaluate_takes_a_method_with_options(model_store: Path, tmp_path: Path) -> None:
    method = '{"name": "action_diffusion", "sampler": "ddim", "steps": 2}'
    options = ("--sequences", "2", "--runs", "1", "-k", "16", "--method", method)
    done = breakaway("evaluate", "multistep-random", *options, cwd=tmp_path, store=model_store)
    assert done.returncode == 0, done.stderr
    row = next(line for line in done.stdout.splitlines() if "`action_diffusion`" in line)
    assert row.startswith("| `action_diffusion`, sampler ddim, steps 2 | 16 |")
    assert "(0.17)" in row


def test_evaluate_refuses_a_method_that_is_no_json(model_store: Path, tmp_path: Path) -> None:
    options = ("--method", '{"name": ')
    done = breakaway("evaluate", "multistep-random", *options, cwd=tmp_path, store=model_store)
    assert done.returncode == 1
    assert "--method is neither a name nor a JSON object" in done.stderr
