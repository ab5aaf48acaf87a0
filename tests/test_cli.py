"""The `breakaway` command, as a user runs it: another process, another directory."""

import asyncio
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from typer.testing import CliRunner

from app import cli
from app.evaluation.suites import SUITES
from app.launch import START_SECONDS, free_port
from app.main import create_app
from app.settings import SHIPPED_MODELS, Settings
from tests.served import running


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
        timeout=START_SECONDS,
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


def test_keys_that_cannot_be_used_are_said(tmp_path: Path, model_store: Path) -> None:
    for file, complaint in (("nowhere", "cannot read"), ("keys", "holds no key")):
        (tmp_path / "keys").touch()
        options = ("--model-store", str(model_store), "--api-keys-file", str(tmp_path / file))
        done = CliRunner().invoke(cli.app, ["serve", *options])
        assert done.exit_code == 1
        assert isinstance(done.exception, SystemExit)
        assert complaint in done.stderr
        assert str(tmp_path / file) in done.stderr


def test_serve_serves_and_ends_on_sigterm(model_store: Path, tmp_path: Path) -> None:
    port = free_port()
    command = [sys.executable, "-m", "app", "serve", "--port", str(port)]
    environment = os.environ | {"BREAKAWAY_MODEL_STORE": str(model_store)}
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
            answer = httpx.post(f"http://127.0.0.1:{port}/plan", json=body, timeout=60)
            assert answer.status_code == 200
            assert answer.json()["model"]["name"] == "tiny"
        finally:
            server.send_signal(signal.SIGTERM)
        assert server.wait(timeout=30) in (0, -signal.SIGTERM)
    lines = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    (planned,) = [line for line in lines if line.get("path") == "/plan"]
    assert planned["logger"] == "breakaway.access"
    assert planned["status"] == 200


def _is_ready(port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{port}/readyz").is_success
    except httpx.TransportError:
        return False


def test_a_quick_evaluation_says_where_its_report_is(model_store: Path, tmp_path: Path) -> None:
    options = ("multistep-reference", "--quick", "--out", "found")
    done = breakaway("evaluate", *options, cwd=tmp_path, store=model_store)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "found/report.md\n"
    assert "## A multi-step reference (Figure 4)" in (tmp_path / "found/report.md").read_text()


def test_an_unknown_suite_is_named_with_those_that_there_are(tmp_path: Path) -> None:
    done = breakaway("evaluate", "multistep-random", "annealing", cwd=tmp_path)
    assert done.returncode == 1
    assert "no suite annealing" in done.stderr
    for name, suite in SUITES.items():
        assert f"{name:22}{suite.purpose}\n" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_evaluation_with_a_missing_store_ends_at_once(tmp_path: Path) -> None:
    options = ("multistep-reference", "--quick")
    done = breakaway("evaluate", *options, cwd=tmp_path, store=Path("nowhere"))
    assert done.returncode == 1
    assert "nowhere is not a directory" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_evaluation_brings_its_key(tmp_path: Path) -> None:
    key = "first-key-0123456789"

    async def name_of_service() -> str:
        async with cli._client(url, key) as client:
            return (await client.info()).name

    with running(create_app(Settings(model_store=tmp_path, api_keys=key))) as url:
        assert asyncio.run(name_of_service()) == "breakaway"
        options = ["evaluate", "--quick", "--url", url, "--out", str(tmp_path / "found")]
        wrong = CliRunner().invoke(cli.app, options, env={"BREAKAWAY_API_KEY": key + "x"})
    assert wrong.exit_code == 1
    assert "Unauthorized (401)" in wrong.stderr


def test_an_evaluation_of_an_absent_service_says_so_soon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "ARRIVAL_SECONDS", 0.1)
    url = f"http://127.0.0.1:{free_port()}"
    options = ("--quick", "--url", url, "--out", str(tmp_path))
    done = CliRunner().invoke(cli.app, ["evaluate", *options])
    assert done.exit_code == 1
    assert isinstance(done.exception, SystemExit)
    assert f"no answer from {url}" in done.stderr
