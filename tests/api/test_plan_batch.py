"""`POST /plan_batch` over real HTTP: a line for each problem, whatever else happens."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep
from typing import Any

import httpx
import pytest

from app.settings import Settings
from app.wire.batches import MAX_PROBLEMS, problem_seed
from tests.api.test_errors import assert_problem
from tests.api.test_plan import plan, without_timing
from tests.metrics import pending, value
from tests.served import serving, wait_until, wait_until_ready

REFINED: dict[str, Any] = {"method": "dataset_prior", "refine": True, "num_candidates": 4}
ENDLESS: dict[str, Any] = {"method": "cem", "num_candidates": 16, "reachability": False}
"""With thousands of problems it takes seconds."""


def problems(count: int) -> list[dict[str, Any]]:
    return [{"initial_state": [0.001 * i, 0.0], "target_state": [0.3, 0.0]} for i in range(count)]


def ask(client: httpx.Client, problems: list[Any], **fields: Any) -> dict[int, dict[str, Any]]:
    """Return the lines of an answer by their index, each of which must come once."""
    body = {"problems": problems, "seed": 7, "num_candidates": 4, **fields}
    response = client.post("/plan_batch", json=body)
    assert response.status_code == 200, response.text
    assert response.headers["Content-Type"] == "application/x-ndjson"
    assert response.text.endswith("\n")
    lines = [json.loads(line) for line in response.text.split("\n")[:-1]]
    by_index = {line.pop("index"): line for line in lines}
    assert len(lines) == len(problems)
    assert set(by_index) == set(range(len(problems)))
    return by_index


@contextmanager
def reading(client: httpx.Client, count: int, **fields: Any) -> Iterator[Iterator[dict[str, Any]]]:
    """Ask for many plans; yield the lines, which are read as they are asked for."""
    body = {"problems": problems(count), "seed": 7, **fields}
    with client.stream("POST", "/plan_batch", json=body) as response:
        assert response.status_code == 200
        yield map(json.loads, response.iter_lines())


@pytest.mark.parametrize(
    "fields",
    [
        REFINED,
        REFINED | {"objective": "control_energy", "reachability": False, "include": []},
        {"method": {"name": "cem", "iterations": 5}, "include": ["states", "candidates"]},
        {"method": "cem", "initial": {"method": "action_diffusion"}, "pending_controls": [0.9]},
        {"method": "action_diffusion"},
        {"method": "mppi", "horizon": 20, "system": "belt_cart"},
        {"uncertainty": {"relative": {"coulomb_friction": 0.1}}, "method": "uniform"},
    ],
    ids=lambda fields: str(fields.get("method")),
)
def test_each_plan_is_the_one_that_its_problem_has_alone(
    client: httpx.Client, fields: dict[str, Any]
) -> None:
    asked = problems(9)
    asked[4]["seed"] = 11
    asked[6]["system"] = {"static_friction": 0.62, **({"control_limit": 0.9})}
    if fields["method"] == "action_diffusion" or "initial" in fields:
        del asked[6]["system"]  # the tiny model covers one plant

    lines = ask(client, asked, **fields)

    for index, problem in enumerate(asked):
        alone = plan(client, **({**fields, "seed": lines[index]["seed"]} | problem))
        assert without_timing(lines[index]) == without_timing(alone)
    assert lines[4]["seed"] == 11
    assert lines[5]["seed"] == problem_seed(7, 5)


def test_a_batch_without_a_seed_draws_one(client: httpx.Client) -> None:
    first, other = (ask(client, problems(2), seed=None, method="uniform") for _ in range(2))
    assert len({line["seed"] for lines in (first, other) for line in lines.values()}) == 4


@pytest.mark.parametrize("method", ["dataset_prior", "action_diffusion"])
def test_hundreds_are_answered_once_each(client: httpx.Client, method: str) -> None:
    lines = ask(client, problems(300), method=method, include=[])
    assert all("controls" in line for line in lines.values())


def test_one_bad_problem_is_one_bad_line(client: httpx.Client) -> None:
    good = problems(1)[0]
    bad: dict[str, tuple[Any, str, str]] = {
        "no object": (7, "", "must be an object"),
        "nothing": ({}, "/initial_state", "Field required"),
        "text": (good | {"target_state": ["a", 0]}, "/target_state/0", "valid number"),
        "huge": (good | {"target_state": [1e9, 0]}, "/target_state/0", "less than or equal"),
        "extra": (good | {"target": 1}, "/target", "Extra inputs"),
        "true": (good | {"seed": True}, "/seed", "valid integer"),
        "machine": (good | {"system": "nope"}, "/system", "no machine 'nope'"),
        "plant": (good | {"system": {"static_friction": 0.1}}, "/system", "must not exceed"),
    }
    asked = [good, *(problem for problem, _, _ in bad.values()), good]

    lines = ask(client, asked, **REFINED)

    assert "controls" in lines[0]
    assert "controls" in lines[len(asked) - 1]
    for index, (_, pointer, detail) in enumerate(bad.values(), 1):
        (problem,) = lines[index].values()
        assert problem["status"] == 422
        assert problem["type"] == "urn:breakaway:problem:invalid-request"
        assert problem["instance"] == "/plan_batch"
        assert problem["errors"][0]["pointer"] == f"/problems/{index}{pointer}"
        assert detail in problem["errors"][0]["detail"]


def test_a_plant_that_no_model_covers_is_a_bad_line(client: httpx.Client) -> None:
    asked = problems(3)
    asked[1]["system"] = "emps"
    lines = ask(client, asked)
    assert [set(lines[i]) == {"problem"} for i in range(3)] == [False, True, False]
    assert lines[1]["problem"]["errors"][0]["pointer"] == "/problems/1/system"


def test_the_shared_plant_need_not_be_one_that_can_be_planned_for(client: httpx.Client) -> None:
    asked = [problem | {"system": {}} for problem in problems(3)]
    assert all("controls" in line for line in ask(client, asked, system="emps").values())


@pytest.mark.parametrize(
    ("fields", "status", "pointer"),
    [
        ({"problems": []}, 422, "/problems"),
        ({"problems": [0] * (MAX_PROBLEMS + 1)}, 422, "/problems"),
        ({"problems": {}}, 422, "/problems"),
        ({"method": "nope"}, 422, "/method"),
        ({"initial_state": [0, 0]}, 422, "/initial_state"),
        ({"num_candidates": 100_000}, 422, "/num_candidates"),
        ({"num_candidates": 4096, "problems": problems(1500)}, 422, "/problems"),
        ({"method": "action_diffusion", "system": "emps"}, 422, "/system"),
        ({"method": "action_diffusion", "model": "nope"}, 404, None),
        ({"deadline_ms": 1, "problems": problems(1000)}, 429, None),
    ],
)
def test_what_all_share_is_refused_at_once(
    client: httpx.Client, fields: dict[str, Any], status: int, pointer: str | None
) -> None:
    body = {"problems": problems(2), "method": "cem", **fields}
    response = client.post("/plan_batch", json=body)
    assert_problem(response, status)
    if pointer:
        assert response.json()["errors"][0]["pointer"] == pointer


def test_a_batch_may_have_a_large_body_and_nothing_else_may(tmp_path: Path) -> None:
    settings = Settings(model_store=tmp_path, max_body_bytes=2000, max_batch_body_bytes=20_000)
    with serving(settings) as client:
        wait_until_ready(client)
        assert len(ask(client, problems(100), method="uniform", include=[])) == 100
        body = {"problems": problems(1000), "method": "uniform"}
        assert_problem(client.post("/plan_batch", json=body), 413)
        assert_problem(client.post("/plan", json=body), 413)


def test_a_batch_needs_a_key_where_one_is_asked_for(tmp_path: Path) -> None:
    with serving(Settings(model_store=tmp_path, api_keys="0123456789abcdef")) as client:
        assert_problem(client.post("/plan_batch", json={"problems": problems(1)}), 401)


def test_a_slow_reader_holds_up_nobody(client: httpx.Client) -> None:
    with reading(client, 3000, method="uniform") as lines:
        first = next(lines)
        sleep(0.3)  # long enough to make all of them, if nobody had to take them
        assert pending(client) == 1
        held = value(client.get("/metrics").text, "breakaway_answer_bytes")
        for _ in range(5):
            plan(client, method="dataset_prior", deadline_ms=20_000)
        assert pending(client) == 1
        indices = {first["index"], *(line["index"] for line in lines)}
    assert indices == set(range(3000))
    assert held < 10_000_000
    wait_until(lambda: pending(client) == 0)


@pytest.mark.parametrize("method", ["cem", "action_diffusion"])
def test_others_come_in_while_a_batch_is_at_work(client: httpx.Client, method: str) -> None:
    with reading(client, 2000, **ENDLESS | {"method": method}) as lines:
        next(lines)
        for other in ("cem", "action_diffusion"):
            plan(client, method=other)
        assert pending(client) == 1


@pytest.mark.parametrize("method", ["cem", "action_diffusion"])
def test_a_client_that_leaves_ends_its_batch(client: httpx.Client, method: str) -> None:
    with reading(client, 2000, **ENDLESS | {"method": method}) as lines:
        next(lines)
    wait_until(lambda: pending(client) == 0)
    assert value(client.get("/metrics").text, "breakaway_answer_bytes") == 0


@pytest.mark.parametrize("client", ["process"], indirect=True)  # Serve's proxy takes all at once
def test_what_is_not_done_by_the_deadline_says_so(client: httpx.Client) -> None:
    large = {"method": "uniform", "include": ["states", "candidates"], "reachability": False}
    with reading(client, 300, **large, deadline_ms=2000) as lines:
        answers = [next(lines)]
        sleep(2.3)
        answers += lines
    assert {line["index"] for line in answers} == set(range(300))
    late = [line["problem"] for line in answers if "problem" in line]
    assert 0 < len(late) < 300
    assert {problem["status"] for problem in late} == {504}
    assert {problem["type"] for problem in late} == {"urn:breakaway:problem:deadline-exceeded"}


def test_two_batches_at_once_are_both_answered(client: httpx.Client) -> None:
    fields = {"method": "cem", "include": []}
    with reading(client, 60, **fields) as one, reading(client, 60, **fields) as other:
        both = [{line["index"]: without_timing(line) for line in lines} for lines in (one, other)]
    assert both[0] == both[1]
    assert len(both[0]) == 60
