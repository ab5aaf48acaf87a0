"""Runs as a user simulates them; no model is needed."""

import json
from pathlib import Path

import pytest

from app.wire.simulation import SimulateResponse
from tests.cli.command import invoke

SIMULATE = ("control", "--seed", "7")
TARGET = ("--target-state", "0.2", "0")
OFF = (
    "--system",
    '{"static_friction": 0.8, "coulomb_friction": 0.65}',
    "--nominal-system",
    "paper",
)


def test_it_prints_writes_and_draws_runs(tmp_path: Path) -> None:
    noise = ("--disturbance", '{"acceleration_noise": 0.05}', "--num-runs", "3")
    files = ("--json", str(tmp_path / "runs.json"), "--picture", str(tmp_path / "runs.png"))
    done = invoke(*SIMULATE, *TARGET, *OFF, *noise, *files)
    assert done.exit_code == 0, done.stderr
    answer = SimulateResponse.model_validate_json((tmp_path / "runs.json").read_text())
    assert [run.seed for run in answer.runs] == [7, 8, 9]
    for run in answer.runs:
        assert run.final_error is not None
        assert f"{run.final_error:.6f}" in done.stdout
        assert run.status == "arrived"
    assert "3 settled within" in done.stdout
    assert "from (s)" in done.stdout
    assert (tmp_path / "runs.png").read_bytes().startswith(b"\x89PNG")


def test_a_file_says_what_options_do_not_override(tmp_path: Path) -> None:
    request = {"controls": [0.9] * 10 + [-0.9] * 10, "include": [], "steps": 30}
    (tmp_path / "request.json").write_text(json.dumps(request))
    file = ("--request", str(tmp_path / "request.json"))
    done = invoke(*SIMULATE, *file, "--steps", "25", "--json", "-")
    assert done.exit_code == 0, done.stderr
    (run,) = json.loads(done.stdout)["runs"]
    assert len(run["controls"]) == 25
    assert run["controls"][:20] == request["controls"]
    assert "states" not in run
    picture = ("--json", "-", "--picture", str(tmp_path / "runs.svg"))
    assert "states" not in json.loads(invoke(*SIMULATE, *file, *picture).stdout)["runs"][0]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ((), "A run needs a --target-state"),
        (("--target-state", "0.2", "1"), "--target-state: a closed loop comes to rest"),
        ((*TARGET, "--controller", "lqr"), "--controller: no controller 'lqr'; there are"),
        ((*TARGET, "--controller", '{"name": "pd", "derivative": -1}'), "--controller /derivative"),
        ((*TARGET, "--sensor", '{"noise": 1}'), "--sensor /noise"),
        ((*TARGET, "--disturbance", "{"), "--disturbance: not JSON"),
        ((*TARGET, "--nominal-system", '{"time_step": 0.01}'), "--nominal-system /time_step"),
        ((*TARGET, "--num-runs", "0"), "--num-runs"),
        ((*TARGET, "--picture", "runs.txt"), "--picture: runs.txt must end in one of"),
    ],
)
def test_what_is_at_fault_is_named(options: tuple[str, ...], complaint: str) -> None:
    done = invoke(*SIMULATE, *options)
    assert done.exit_code != 0
    assert complaint in done.stderr
