"""What a file and options come to as a request, and who is at fault where it is none."""

import io
import json
from pathlib import Path
from typing import Any

import click
import pytest

from app.cli.plan_request import read_request
from app.failure import Failure
from app.wire.requests import MultistepPlanRequest, PlanRequest

WHOLE = {
    "initial_state": [0.1, -0.2],
    "target_state": [0.2, 0.0],
    "method": {"name": "cem", "iterations": 7},
    "num_candidates": 32,
    "seed": 5,
    "system": {"static_friction": 0.8, "control_limit": 1.2},
    "pending_controls": [0.9, -0.9],
    "horizon": 48,
    "model": "tiny",
    "initial": {"method": "uniform"},
    "refine": {"iterations": 3},
    "objective": "control_energy",
    "deadline_ms": 1000,
    "include": ["candidates"],
}
SEVERAL = WHOLE | {"targets": [[0.4, 0.0], [-0.4, 0.0]]}
del SEVERAL["target_state"]


def read(body: Any = None, **options: Any) -> PlanRequest | MultistepPlanRequest:
    return read_request(io.BytesIO(json.dumps(body).encode()) if body else None, options)


def refusal(body: Any = None, **options: Any) -> list[str]:
    with pytest.raises(Failure) as refused:
        read(body, **options)
    return refused.value.message.splitlines()


def test_a_file_is_a_whole_request() -> None:
    assert read(WHOLE) == PlanRequest.model_validate(WHOLE)


def test_a_file_with_targets_is_a_multistep_request() -> None:
    assert read(SEVERAL) == MultistepPlanRequest.model_validate(SEVERAL)


def test_options_alone_are_a_request_from_rest() -> None:
    assert read(target_state=(0.2, 0.0)) == PlanRequest(
        initial_state=(0.0, 0.0), target_state=(0.2, 0.0)
    )


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("initial_state", (0.0, 0.0)),
        ("target_state", (0.3, 0.1)),
        ("method", "mppi"),
        ("system", "emps"),
        ("num_candidates", 4),
        ("seed", 6),
        ("model", "other/2"),
        ("horizon", 96),
        ("refine", True),
        ("objective", "stuck_steps"),
    ],
)
def test_an_option_overrides_what_the_file_says(option: str, value: Any) -> None:
    assert read(WHOLE, **{option: value}) == PlanRequest.model_validate(WHOLE | {option: value})


def test_a_method_may_be_an_object() -> None:
    method = {"name": "cem", "iterations": 3}
    assert read(target_state=(0.2, 0.0), method=json.dumps(method)) == PlanRequest.model_validate(
        {"initial_state": (0.0, 0.0), "target_state": (0.2, 0.0), "method": method}
    )


def test_a_system_may_be_an_object() -> None:
    system = {"static_friction": {"forward": 0.8, "backward": 0.7}, "bias": -0.1}
    asked = read(WHOLE, system=json.dumps(system))
    assert asked == PlanRequest.model_validate(WHOLE | {"system": system})


@pytest.mark.parametrize(
    ("content", "uncertainty"),
    [
        (
            {"relative": {"bias": 0.1}, "risk": "worst"},
            {"relative": {"bias": 0.1}, "risk": "worst"},
        ),
        ({"systems": [{}, {"bias": 0.1}]}, {"systems": [{}, {"bias": 0.1}]}),
        (
            {"system": {}, "systems": [{"bias": 0.1}], "delay_steps": 2, "seed": 1},
            {"systems": [{"bias": 0.1}]},
        ),
    ],
)
def test_uncertainty_may_be_a_file_as_identification_writes_it(
    tmp_path: Path, content: Any, uncertainty: Any
) -> None:
    (tmp_path / "answer.json").write_text(json.dumps(content))
    asked = read(WHOLE, uncertainty=str(tmp_path / "answer.json"))
    assert asked == PlanRequest.model_validate(WHOLE | {"uncertainty": uncertainty})


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (None, "No such file or directory; it must be a JSON object, or a file of one"),
        ("[1]", "must be a JSON object"),
        ("{", "not JSON"),
        ('{"system": {}}', "it has one plant only; the ensemble is in the answer of breakaway"),
        ('{"risk": "worst"}', "either systems or relative"),
    ],
)
def test_a_file_without_an_ensemble_is_told_of(
    tmp_path: Path, content: str | None, fault: str
) -> None:
    file = tmp_path / "answer.json"
    if content is not None:
        file.write_text(content)
    (line,) = refusal(WHOLE, uncertainty=str(file))
    assert line.startswith("--uncertainty")
    assert fault in line


def test_pending_controls_may_be_an_option() -> None:
    asked = read(WHOLE, pending_controls="[0, 0.5]")
    assert asked == PlanRequest.model_validate(WHOLE | {"pending_controls": [0, 0.5]})


def test_a_target_overrides_the_targets_of_the_file() -> None:
    request = read(SEVERAL, target_state=(0.2, 0.0))
    assert request == PlanRequest.model_validate(WHOLE)


def test_options_other_than_the_target_keep_the_targets_of_the_file() -> None:
    request = read(SEVERAL, seed=6)
    assert request == MultistepPlanRequest.model_validate(SEVERAL | {"seed": 6})


@pytest.mark.parametrize(
    ("body", "options", "fault"),
    [
        (WHOLE | {"num_candidates": 0}, {}, "/num_candidates: "),
        (WHOLE, {"num_candidates": 0}, "--num-candidates: "),
        (WHOLE | {"system": {"time_step": 0}}, {"seed": 1}, "/system/time_step: "),
        (WHOLE | {"mass": 1}, {}, "/mass: "),
        (SEVERAL | {"target_state": [0, 0]}, {}, "/target_state: "),
        (SEVERAL | {"targets": []}, {}, "/targets: "),
        ({"seed": 1}, {}, "/target_state: Field required"),
        (WHOLE, {"target_state": (float("nan"), 0.0)}, "--target-state: NaN is not a finite"),
        (WHOLE, {"initial_state": (0.0, float("inf"))}, "--initial-state: Infinity is not a"),
        (WHOLE, {"method": "annealing"}, "--method: no method 'annealing'; there are: 'action"),
        (WHOLE, {"method": '{"name": "cem", "iterations": 0}'}, "--method /iterations: "),
        (WHOLE, {"method": '{"name": '}, "--method: not JSON: Expecting value at line"),
        (WHOLE, {"method": '{"name": "cem", "name": "mppi"}'}, "--method /name: the key appears"),
        (WHOLE, {"objective": "comfort"}, "--objective: "),
        (WHOLE, {"system": "lathe"}, "--system: no machine 'lathe'; there are: 'paper', 'emps'"),
        (WHOLE, {"system": '{"time_step": 0}'}, "--system /time_step: "),
        (WHOLE, {"system": '{"bias": 1, "bias": 1}'}, "--system /bias: the key appears"),
        (WHOLE, {"system": '{"bias"'}, "--system: not JSON: "),
        (
            WHOLE,
            {"system": '{"control_limit": {"lower": true, "upper": 1}}'},
            "--system /control_limit/lower: ",
        ),
        (WHOLE, {"system": '{"control_limit": "1"}'}, "--system /control_limit: must be a number"),
        (WHOLE | {"pending_controls": [0, "1"]}, {}, "/pending_controls/1: "),
        (WHOLE, {"model": ""}, "--model: "),
        (WHOLE, {"pending_controls": '[0, "1"]'}, "--pending-controls /1: "),
        (WHOLE, {"pending_controls": "0"}, "--pending-controls: must be an array"),
        ([WHOLE], {}, "--request: must be a JSON object"),
    ],
)
def test_a_field_at_fault_is_named_by_where_it_came_from(
    body: Any, options: dict[str, Any], fault: str
) -> None:
    (line,) = refusal(body, **options)
    assert line.startswith(fault)


def test_each_field_at_fault_has_a_line() -> None:
    lines = refusal(WHOLE | {"horizon": 0}, seed=-1)
    assert [line.split(":")[0] for line in lines] == ["--seed", "/horizon"]


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"{", "--request: not JSON: Expecting property name"),
        (b"", "--request: not JSON: it is empty"),
        (b"\xff\xfe\xfd", "--request: not UTF-8: byte 0xff at position 0"),
        (10_000 * b"[", "--request: arrays and objects are nested too deeply"),
        (b'{"system": {"time_step": 1, "time_step": 1}}', "/system/time_step: the key appears"),
        (b'{"seed": 1, "seed": 2}', "/seed: the key appears more than once"),
        (b'{"seed": 1e999}', "/seed: 1e999 is too large a number"),
    ],
)
def test_a_file_that_cannot_be_read_is_told_why(content: bytes, fault: str) -> None:
    with pytest.raises(Failure) as refused:
        read_request(io.BytesIO(content), {"seed": 3})
    assert refused.value.message.startswith(fault)


def test_a_file_is_read_as_the_service_reads_a_body() -> None:
    text = b'\xef\xbb\xbf{"target_state": [0.2, 0], "num_candidates": 4.0}'
    request = read_request(io.BytesIO(text), {})
    assert request == PlanRequest(
        initial_state=(0.0, 0.0), target_state=(0.2, 0.0), num_candidates=4
    )


def test_without_a_file_there_must_be_a_target() -> None:
    with pytest.raises(click.UsageError, match="--target-state"):
        read(seed=1)
