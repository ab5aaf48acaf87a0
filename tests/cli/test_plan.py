"""Plans as a user makes them; an empty store will do for methods that need no model."""

import json
from pathlib import Path
from typing import Any

import pytest

from app.planning.plant.machines import MACHINES
from app.wire.answers import MultistepPlanResponse, PlanResponse
from tests.cli.command import invoke, run, run_python

TARGET = ("--target-state", "0.2", "0")
UNIFORM = (*TARGET, "--method", "uniform", "--seed", "7")
SEVERAL = {
    "initial_state": [0.0, 0.0],
    "targets": [[0.4, 0.0], [-0.4, 0.0], [0.2, 0.0]],
    "method": "uniform",
    "seed": 7,
}


@pytest.fixture
def empty_store(tmp_path: Path) -> str:
    (tmp_path / "store").mkdir()
    return str(tmp_path / "store")


def test_it_prints_and_writes_a_plan_and_its_picture(model_store: Path, tmp_path: Path) -> None:
    options = ("--seed", "7", "--num-candidates", "4", "--json", "plan.json")
    pictured = (*options, "--picture", "plan.png")
    done = run("plan", "--target-state", "-0.2", "0", *pictured, cwd=tmp_path, store=model_store)
    assert done.returncode == 0, done.stderr
    written = json.loads((tmp_path / "plan.json").read_text())
    assert written["seed"] == 7
    assert len(written["controls"]) == 64
    assert "candidates" not in written
    assert f"{written['terminal_error']:.6f}" in done.stdout
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")


def test_json_on_standard_output_stands_there_alone(empty_store: str) -> None:
    done = invoke("plan", *UNIFORM, "--json", "-", BREAKAWAY_MODEL_STORE=empty_store)
    assert done.exit_code == 0, done.stderr
    answer = PlanResponse.model_validate_json(done.stdout)
    assert f"{answer.terminal_error:.6f}" in done.stderr


def test_a_request_is_read_from_a_file_and_options_override_it(
    empty_store: str, tmp_path: Path
) -> None:
    body = {"target_state": [0.2, 0.0], "method": "uniform", "horizon": 32, "seed": 1}
    (tmp_path / "request.json").write_text(json.dumps(body | {"include": ["candidates"]}))
    request = ("--request", str(tmp_path / "request.json"), "--num-candidates", "3", "--seed", "2")
    done = invoke("plan", *request, "--json", "-", BREAKAWAY_MODEL_STORE=empty_store)
    assert done.exit_code == 0, done.stderr
    answer = PlanResponse.model_validate_json(done.stdout)
    assert len(answer.controls) == 32
    assert answer.seed == 2
    assert answer.states is None
    assert answer.candidates is not None
    assert len(answer.candidates.controls) == 3


def test_a_request_is_read_from_standard_input(empty_store: str) -> None:
    body = {"initial_state": [0.1, 0.0], "target_state": [0.2, 0.0], "method": "uniform"}
    done = invoke(
        *("plan", "--request", "-", "--seed", "7", "--json", "-"),
        standard_input=json.dumps(body),
        BREAKAWAY_MODEL_STORE=empty_store,
    )
    assert done.exit_code == 0, done.stderr
    answer = PlanResponse.model_validate_json(done.stdout)
    assert answer.seed == 7
    assert answer.states is not None
    assert answer.states[0] == (0.1, 0.0)


def test_several_targets_get_the_multistep_answer(empty_store: str, tmp_path: Path) -> None:
    done = invoke(
        *("plan", "--request", "-", "--json", str(tmp_path / "plan.json")),
        standard_input=json.dumps(SEVERAL),
        BREAKAWAY_MODEL_STORE=empty_store,
    )
    assert done.exit_code == 0, done.stderr
    answer = MultistepPlanResponse.model_validate_json((tmp_path / "plan.json").read_text())
    rows = [line for line in done.stdout.splitlines() if line.startswith(("0.4, 0", "-0.4", "0.2"))]
    for row, segment in zip(rows, answer.segments, strict=True):
        assert f"{segment.terminal_error:.6f}" in row
    assert f"{answer.final_error:.6f}" in done.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((*TARGET, "--model", "nope"), "--model: no model 'nope'; there are: tiny/1"),
        ((*TARGET, "--num-candidates", "1000000"), "--num-candidates: 1000000 candidates; at most"),
        (
            (*TARGET, "--method", '{"name": "action_diffusion", "steps": 92}'),
            "--method /steps: steps must be from 1 to 91",
        ),
    ],
)
def test_what_the_service_refuses_is_named_by_its_option(
    model_store: Path, options: tuple[str, ...], message: str
) -> None:
    done = invoke("plan", *options, BREAKAWAY_MODEL_STORE=str(model_store))
    assert done.exit_code == 1
    assert done.stdout == ""
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"model": "nope"}, "/model: no model 'nope'"),
        ({"horizon": 2000}, "/horizon: 2000 time steps; at most 1024"),
        ({"pending_controls": [0.0, 1.0]}, "/pending_controls/1: 1 is beyond the plant's limits"),
        (
            {"system": "emps"},
            "/system: no model was trained for this plant and horizon 64 (other methods need "
            "none); there are: tiny/1 for plants with static_friction 0.7, "
            "coulomb_friction 0.6, viscous_damping 0.05, control_limit 0.9, time_step 0.05, "
            "velocity_threshold 0.001, the same both ways, "
            "without bias, gain or Stribeck effect, and horizon 64",
        ),
        ({"system": {"static_friction": 0.65}}, "/system: no model was trained for"),
        ({"method": "uniform", "initial": {"method": "cem"}}, "/initial: uniform starts from"),
    ],
)
def test_what_the_service_refuses_is_named_by_its_field_of_the_file(
    model_store: Path, fields: dict[str, Any], message: str
) -> None:
    done = invoke(
        *("plan", "--request", "-"),
        standard_input=json.dumps({"target_state": [0.2, 0.0]} | fields),
        BREAKAWAY_MODEL_STORE=str(model_store),
    )
    assert done.exit_code == 1
    assert done.stderr.startswith(message)


def test_a_machine_is_planned_for_in_its_own_unit_of_control(empty_store: str) -> None:
    asked = ("--target-state", "0.01", "0", "--method", "dataset_prior", "--refine", "--seed", "1")
    done = invoke(
        *("plan", *asked, "--system", "rack_and_pinion", "--json", "-"),
        BREAKAWAY_MODEL_STORE=empty_store,
    )
    assert done.exit_code == 0, done.stderr
    answer = PlanResponse.model_validate_json(done.stdout)
    assert answer.system == MACHINES["rack_and_pinion"].system
    assert answer.reachability is not None
    assert f"floor error          {answer.reachability.floor_error:.1e} m" in done.stderr
    emps = invoke("plan", *asked, "--system", "emps", BREAKAWAY_MODEL_STORE=empty_store)
    assert "units of control²" in emps.stdout
    assert "floor error" not in emps.stdout


def test_pending_controls_are_taken_from_a_file(empty_store: str) -> None:
    body = {"target_state": [0.2, 0.0], "method": "uniform", "pending_controls": [0.9, 0.8]}
    done = invoke(
        *("plan", "--request", "-", "--json", "-"),
        standard_input=json.dumps(body),
        BREAKAWAY_MODEL_STORE=empty_store,
    )
    assert done.exit_code == 0, done.stderr
    answer = PlanResponse.model_validate_json(done.stdout)
    assert answer.states is not None
    # Two steps from rest, by hand.
    first = 0.05 * (0.9 - 0.6)
    second = first + 0.05 * (0.8 - 0.6 - 0.05 * first)
    assert answer.predicted_initial_state == pytest.approx((0.05 * (first + second), second))
    assert answer.predicted_initial_state == answer.states[0]


def test_limits_come_from_the_environment(empty_store: str) -> None:
    environment = {"BREAKAWAY_MODEL_STORE": empty_store, "BREAKAWAY_MAX_CANDIDATES": "8"}
    done = invoke("plan", *UNIFORM, **environment)
    assert done.exit_code == 1
    assert done.stderr.startswith("/num_candidates: 16 candidates; at most 8 are allowed")


def test_a_bad_setting_is_named_by_its_variable() -> None:
    done = invoke("plan", *UNIFORM, BREAKAWAY_MAX_CANDIDATES="0")
    assert done.exit_code == 1
    assert done.stderr == "BREAKAWAY_MAX_CANDIDATES: Input should be greater than 0\n"


def test_a_compiled_method_needs_neither_torch_nor_a_model(tmp_path: Path) -> None:
    script = (
        "import sys; from app.cli import breakaway; "
        f"breakaway(['plan', *{UNIFORM!r}], standalone_mode=False); print('torch' in sys.modules)"
    )
    done = run_python(script, cwd=tmp_path, store=tmp_path / "nowhere")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "False"


def test_a_missing_store_is_said() -> None:
    done = invoke("plan", *TARGET, BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 1
    assert done.stderr == "the model store nowhere is not a directory\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--json", "no/such/folder.json"), "--json: no/such/folder.json: No such file"),
        (("--json", "."), "--json: .: Is a directory"),
        (("--picture", "no/such/plan.png"), "--picture: no/such/plan.png: No such file"),
        (("--picture", "plan.nope"), "--picture: plan.nope must end in one of: "),
        (("--picture", "plan"), "--picture: plan must end in one of: "),
    ],
)
def test_an_output_that_cannot_be_written_is_noticed_before_planning(
    options: tuple[str, ...], message: str
) -> None:
    done = invoke("plan", *UNIFORM, *options, BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 1
    assert done.stderr.startswith(message)


def test_that_several_targets_have_no_picture_is_noticed_before_planning() -> None:
    done = invoke(
        *("plan", "--request", "-", "--picture", "plan.png"),
        standard_input=json.dumps(SEVERAL),
        BREAKAWAY_MODEL_STORE="nowhere",
    )
    assert done.exit_code == 1
    assert done.stderr.startswith("--picture: plans to several targets are not drawn")


def test_a_plan_that_fails_leaves_its_outputs_as_they_were(tmp_path: Path) -> None:
    kept, absent = tmp_path / "kept.json", tmp_path / "absent.png"
    kept.write_text("the last plan")
    outputs = ("--json", str(kept), "--picture", str(absent))
    done = invoke("plan", *TARGET, *outputs, BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 1
    assert kept.read_text() == "the last plan"
    assert not absent.exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "A plan needs a --target-state"),
        (("--request", "no-such.json"), "'--request': 'no-such.json': No such file"),
        ((*TARGET, "--num-candidates", "many"), "'--num-candidates': 'many' is not a valid"),
        (("--target-state", "0.2"), "--target-state"),
    ],
)
def test_wrong_usage_is_said(options: tuple[str, ...], message: str) -> None:
    done = invoke("plan", *options)
    assert done.exit_code == 2
    assert message in done.stderr


def test_a_plan_for_uncertain_plants_says_what_it_is_worth(empty_store: str) -> None:
    uncertainty = json.dumps({"relative": {"coulomb_friction": 0.1}, "num_motions": 16})
    asked = (*UNIFORM, "--refine", "--uncertainty", uncertainty)
    done = invoke("plan", *asked, "--json", "-", BREAKAWAY_MODEL_STORE=empty_store)
    assert done.exit_code == 0, done.stderr
    robustness = PlanResponse.model_validate_json(done.stdout).robustness
    assert robustness is not None
    for number in (robustness.value, robustness.median_error, robustness.worst_error):
        assert f"{number:.6f}" in done.stderr


def test_uncertainty_that_is_none_is_refused_by_its_option(empty_store: str) -> None:
    for text, place in (
        ('{"relative": {"bias": 2}}', "--uncertainty /relative/bias: "),
        ('{"systems": [{"time_step": 0.01}]}', "--uncertainty /systems/0/time_step: "),
        ("much", "--uncertainty: "),
    ):
        done = invoke("plan", *UNIFORM, "--uncertainty", text, BREAKAWAY_MODEL_STORE=empty_store)
        assert done.exit_code == 1
        assert place in done.stderr
