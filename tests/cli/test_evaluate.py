"""An evaluation from the command line, of a service in its process and of one elsewhere."""

import asyncio
from pathlib import Path

import pytest

from app.cli import evaluate
from app.evaluation.suites import SUITES
from app.launch import free_port
from app.main import create_app
from app.settings import Settings
from tests.cli.command import invoke, run
from tests.served import running


def test_a_quick_evaluation_says_where_its_report_is(paper_store: Path, tmp_path: Path) -> None:
    options = ("multistep-reference", "--quick", "--out", "found")
    done = run("evaluate", *options, cwd=tmp_path, store=paper_store)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "found/report.md\n"
    assert "## A multi-step reference (Figure 4)" in (tmp_path / "found/report.md").read_text()


def test_an_unknown_suite_is_named_with_those_that_there_are() -> None:
    done = invoke("evaluate", "multistep-random", "annealing")
    assert done.exit_code == 1
    assert "no suite annealing" in done.stderr
    for name, suite in SUITES.items():
        assert suite.__doc__ is not None
        assert "\n" not in suite.__doc__
        assert f"{name:22}{suite.__doc__}\n" in done.stderr


def test_a_missing_store_ends_it_at_once(tmp_path: Path) -> None:
    options = ("multistep-reference", "--quick", "--out", str(tmp_path))
    done = invoke("evaluate", *options, BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 1
    assert "nowhere is not a directory" in done.stderr


def test_it_brings_its_key(tmp_path: Path) -> None:
    key = "first-key-0123456789"

    async def name_of_service() -> str:
        async with evaluate.connect(url, key) as client:
            return (await client.info()).name

    with running(create_app(Settings(model_store=tmp_path, api_keys=key))) as url:
        assert asyncio.run(name_of_service()) == "breakaway"
        options = ("--quick", "--url", url, "--out", str(tmp_path / "found"))
        wrong = invoke("evaluate", *options, BREAKAWAY_API_KEY=key + "x")
    assert wrong.exit_code == 1
    assert "Unauthorized (401)" in wrong.stderr


@pytest.mark.parametrize("url", ["http://127.0.0.1:{port}", "127.0.0.1", "http://[::1"])
def test_an_absent_service_is_said_soon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str
) -> None:
    url = url.format(port=free_port())
    monkeypatch.setattr(evaluate, "ARRIVAL_SECONDS", 0.1)
    done = invoke("evaluate", "--quick", "--url", url, "--out", str(tmp_path))
    assert done.exit_code == 1
    assert f"no answer from {url}" in done.stderr


def untimed_tables(report: bytes) -> list[bytes]:
    blocks = (block.strip() for block in report.split(b"\n\n"))
    return [block for block in blocks if block.startswith(b"|") and b"Time" not in block]


@pytest.mark.slow
def test_on_a_cluster_the_tables_are_the_same_to_the_byte(
    paper_store: Path, tmp_path: Path
) -> None:
    pytest.importorskip("ray")
    options = ("multistep-reference", "single-target", "--quick", "--out")
    tables = {}
    for folder, more in (("alone", ()), ("cluster", ("--ray", "--concurrency", "4"))):
        done = run("evaluate", *options, folder, *more, cwd=tmp_path, store=paper_store)
        assert done.returncode == 0, done.stderr
        tables[folder] = untimed_tables((tmp_path / folder / "report.md").read_bytes())
    assert len(tables["alone"]) == 2  # one of each suite
    assert tables["alone"] == tables["cluster"]


def test_a_cluster_is_for_the_service_in_this_process(tmp_path: Path) -> None:
    done = invoke("evaluate", "--ray", "--url", "http://127.0.0.1", "--out", str(tmp_path))
    assert done.exit_code == 1
    assert "--ray is for the service in this process" in done.stderr
