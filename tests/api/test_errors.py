"""What a bad request gets: problem+json that says what is wrong, never a 500."""

import json
import threading
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.api import errors
from app.settings import Settings
from tests.metrics import pending
from tests.served import serving, wait_until, wait_until_ready

GOOD = {"initial_state": [0.0, 0.0], "target_state": [0.2, 0.0], "method": "uniform"}
NAN, INFINITY = float("nan"), float("inf")


def post(client: httpx.Client, body: Any, path: str = "/plan") -> httpx.Response:
    """Send `body` as JSON, with Python's NaN and Infinity literals in it."""
    return client.post(path, content=json.dumps(body), headers={"Content-Type": "application/json"})


def assert_problem(response: httpx.Response, status: int) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = response.json()
    assert problem["status"] == status
    assert problem["title"]
    assert problem["detail"]
    assert problem["type"]
    assert problem["instance"] == response.request.url.path
    assert "Traceback" not in response.text
    return problem


@pytest.mark.parametrize(
    ("fields", "pointer", "detail"),
    [
        ({"initial_state": [0, NAN]}, "/initial_state/1", "NaN is not a finite number"),
        ({"target_state": [INFINITY, 0]}, "/target_state/0", "Infinity is not a finite number"),
        ({"target_state": [0, -INFINITY]}, "/target_state/1", "-Infinity is not a finite number"),
        ({"initial_state": [0.0]}, "/initial_state/1", ""),
        ({"initial_state": [0.0, 0.0, 0.0]}, "/initial_state", ""),
        ({"initial_state": "0,0"}, "/initial_state", ""),
        ({"initial_state": ["0", "0"]}, "/initial_state/0", ""),
        ({"initial_state": None}, "/initial_state", ""),
        (
            {"method": "annealing"},
            "/method",
            "no method 'annealing'; there are: 'action_",
        ),
        ({"method": {"name": "cem", "iterations": 0}}, "/method/iterations", ""),
        ({"method": {"name": "cem", "elite_fraction": NAN}}, "/method/elite_fraction", "NaN"),
        ({"method": {"name": "cem", "elites": 3}}, "/method/elites", ""),
        ({"method": {"iterations": 3}}, "/method", "the method's name is missing"),
        ({"method": 3}, "/method", "must be an object"),
        (
            {"method": {"name": "dataset_prior", "prior": {"kick_probability": 2}}},
            "/method/prior/kick_probability",
            "",
        ),
        (
            {
                "method": {
                    "name": "dataset_prior",
                    "prior": {"kick_probability": 0.9, "medium_probability": 0.9},
                }
            },
            "/method/prior",
            "must not exceed 1",
        ),
        ({"method": {"name": "action_diffusion", "steps": 0}}, "/method/steps", ""),
        ({"method": {"name": "action_diffusion", "steps": 92}}, "/method/steps", "1 to 91"),
        (
            {"method": {"name": "action_diffusion", "sampler": "ddim", "steps": 201}},
            "/method/steps",
            "1 to 200",
        ),
        (
            {"method": {"name": "action_diffusion", "sampler": "paper", "steps": 10}},
            "/method",
            "its own steps and guidance_scale; use ddim",
        ),
        ({"method": {"name": "action_diffusion", "steps": 2.5}}, "/method/steps", ""),
        ({"method": {"name": "action_diffusion", "sampler": "euler"}}, "/method/sampler", ""),
        ({"num_candidates": 0}, "/num_candidates", ""),
        ({"num_candidates": 1.5}, "/num_candidates", ""),
        ({"num_candidates": 10**9}, "/num_candidates", "at most 4096"),
        ({"seed": -1}, "/seed", ""),
        ({"seed": 2**53}, "/seed", ""),
        ({"horizon": 0}, "/horizon", ""),
        ({"horizon": 100_000}, "/horizon", "at most 1024"),
        ({"system": {"coulomb_friction": 0.8}}, "/system", "must not exceed static_friction"),
        ({"system": {"time_step": 0}}, "/system/time_step", ""),
        ({"system": {"mass": 1}}, "/system/mass", ""),
        ({"system": "lathe"}, "/system", "no machine 'lathe'; there are: 'paper', 'emps', "),
        ({"system": {"control_limit": True}}, "/system/control_limit", "must be a number, or an"),
        (
            {"system": {"viscous_damping": {"forward": "0.1", "backward": 0.1}}},
            "/system/viscous_damping/forward",
            "a valid number",
        ),
        (
            {"system": {"static_friction": {"forward": 0.5, "backward": 0.7}}},
            "/system",
            "coulomb_friction must not exceed static_friction forward",
        ),
        (
            {"system": {"control_limit": {"lower": 0.9, "upper": 0.9}}},
            "/system/control_limit",
            "upper must exceed lower",
        ),
        ({"pending_controls": 0.5}, "/pending_controls", "must be an array"),
        ({"pending_controls": [0.5, "0.5"]}, "/pending_controls/1", "a valid number"),
        ({"pending_controls": [NAN]}, "/pending_controls/0", "NaN is not a finite number"),
        ({"pending_controls": [0.0] * 1025}, "/pending_controls", "at most 1024"),
        (
            {"pending_controls": [0.9, -0.9, 0, 0.91]},
            "/pending_controls/3",
            "0.91 is beyond the plant's limits, -0.9 to 0.9",
        ),
        (
            {
                "pending_controls": [2, -1.5],
                "system": {"control_limit": {"lower": -1, "upper": 2}},
            },
            "/pending_controls/1",
            "-1.5 is beyond the plant's limits, -1 to 2",
        ),
        (
            {"method": "action_diffusion", "system": "emps"},
            "/system",
            "the same both ways, without bias, gain or Stribeck effect, and horizon 64",
        ),
        (
            {"method": "action_diffusion", "system": {"static_friction": 0.65}},
            "/system",
            "there are: tiny/1",
        ),
        ({"method": "action_diffusion", "horizon": 32}, "/system", "there are: tiny/1"),
        (
            {"method": "action_diffusion", "model": "tiny", "system": {"viscous_damping": 0.1}},
            "/system",
            "tiny/1 was trained for plants with static_friction 0.7, coulomb_friction 0.6,",
        ),
        (
            {"method": {"name": "action_diffusion", "steps": 90}, "num_candidates": 4096},
            "/num_candidates",
            "rows through the network",
        ),
        (
            {
                "method": {"name": "cem", "iterations": 1000},
                "horizon": 1024,
                "num_candidates": 2048,
            },
            "/num_candidates",
            "simulated time steps",
        ),
        (
            {"include": ["candidates", "states"], "horizon": 1024, "num_candidates": 1000},
            "/include",
            "",
        ),
        ({"include": ["everything"]}, "/include/0", ""),
        ({"initial": {"method": "cem"}}, "/initial", "cem, icem, mppi can be started"),
        ({"method": "cem", "initial": "uniform"}, "/initial", ""),
        ({"method": "cem", "initial": {"method": "annealing"}}, "/initial/method", "no method"),
        ({"refine": 3}, "/refine", ""),
        ({"refine": {"iterations": 0}}, "/refine/iterations", ""),
        ({"refine": {"num_refined": 0}}, "/refine/num_refined", ""),
        ({"refine": {"speed": 1}}, "/refine/speed", ""),
        ({"objective": "fame"}, "/objective", ""),
        ({"surprise": 1}, "/surprise", ""),
    ],
)
def test_a_bad_field_is_named(
    client: httpx.Client, fields: dict[str, Any], pointer: str, detail: str
) -> None:
    problem = assert_problem(post(client, GOOD | fields), 422)
    details = {error["pointer"]: error["detail"] for error in problem["errors"]}
    assert pointer in details
    assert detail in details[pointer]


@pytest.mark.parametrize("field", ["initial_state", "target_state"])
def test_a_missing_state_is_named(client: httpx.Client, field: str) -> None:
    body = {key: value for key, value in GOOD.items() if key != field}
    problem = assert_problem(post(client, body), 422)
    assert [error["pointer"] for error in problem["errors"]] == [f"/{field}"]


@pytest.mark.parametrize("targets", [[], [[0.1, 0.0]] * 65, [[0.1]], [[0.1, NAN]], 3])
def test_bad_targets_are_refused(client: httpx.Client, targets: Any) -> None:
    body = {"initial_state": [0, 0], "targets": targets, "method": "uniform"}
    problem = assert_problem(post(client, body, "/plan_multistep"), 422)
    assert problem["errors"][0]["pointer"].startswith("/targets")


def test_limits_count_every_target(client: httpx.Client) -> None:
    body = {
        "initial_state": [0, 0],
        "targets": [[0.1, 0.0]] * 64,
        "method": {"name": "action_diffusion", "sampler": "paper"},
        "num_candidates": 512,
    }
    problem = assert_problem(post(client, body, "/plan_multistep"), 422)
    assert "rows through the network" in problem["detail"]


@pytest.mark.parametrize("name", ["nope", "tiny/2", "tiny/", "../tiny", "tiny/1/unet.pt"])
def test_an_unknown_model_is_a_404_that_names_those_there_are(
    client: httpx.Client, name: str
) -> None:
    problem = assert_problem(post(client, GOOD | {"model": name}), 404)
    assert "tiny/1" in problem["detail"]


def test_unknown_paths_and_verbs_are_problems_too(client: httpx.Client) -> None:
    assert_problem(client.get("/nope"), 404)
    response = client.get("/plan")
    assert_problem(response, 405)
    assert response.headers["allow"] == "POST"


LIKELY: list[Any] = [
    *("uniform", "cem", [0.0, 0.0], 3, {"name": "cem"}, "servo", [0.9, -0.9, 0.3]),
    {"static_friction": {"forward": 0.7, "backward": 1}, "control_limit": {"lower": 0, "upper": 2}},
    {"coulomb_friction": {"forward": 0.1}, "control_limit": {"lower": 2, "upper": -2}, "bias": 9},
]
json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)


@given(
    st.fixed_dictionaries(
        {},
        optional={
            name: json_values | st.sampled_from(LIKELY)
            for name in (
                "initial_state",
                "target_state",
                "method",
                "num_candidates",
                "seed",
                "system",
                "pending_controls",
                "horizon",
                "model",
                "include",
                "refine",
                "objective",
            )
        },
    )
)
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_nothing_that_can_be_sent_is_a_server_error(
    client: httpx.Client, body: dict[str, Any]
) -> None:
    response = post(client, body)
    if response.status_code != 200:
        assert response.status_code in (404, 422)
        assert_problem(response, response.status_code)


numbers = st.sampled_from([0, 1e-6, 1e-3, 0.5, 1, 30, 1e6])
plants = st.fixed_dictionaries(
    {},
    optional={
        "static_friction": numbers
        | st.fixed_dictionaries({"forward": numbers, "backward": numbers}),
        "coulomb_friction": numbers
        | st.fixed_dictionaries({"forward": numbers, "backward": numbers}),
        "viscous_damping": numbers
        | st.fixed_dictionaries({"forward": numbers, "backward": numbers}),
        "stribeck_velocity": numbers,
        "bias": numbers | numbers.map(lambda number: -number),
        "control_gain": numbers,
        "control_limit": numbers
        | st.fixed_dictionaries({"lower": numbers.map(lambda number: -number), "upper": numbers}),
        "time_step": numbers,
        "velocity_threshold": numbers,
    },
)


@given(plants, st.booleans(), st.booleans())
@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_the_oddest_plant_is_planned_for_or_refused(
    client: httpx.Client, system: dict[str, Any], refine: bool, is_pushed: bool
) -> None:
    pending = {"pending_controls": [0] * 9} if is_pushed else {}
    response = post(client, GOOD | pending | {"system": system, "refine": refine, "horizon": 16})
    if response.status_code != 200:
        assert_problem(response, 422)


def test_a_full_queue_says_when_to_come_back(model_store: Path) -> None:
    method = {"name": "action_diffusion", "sampler": "ddim", "steps": 100}
    large = {"method": method, "num_candidates": 256}
    with serving(Settings(model_store=model_store, max_pending=1)) as client:
        wait_until_ready(client)
        answers: list[httpx.Response] = []
        thread = threading.Thread(target=lambda: answers.append(post(client, GOOD | large)))
        thread.start()
        wait_until(lambda: pending(client) > 0)
        refused = []
        while thread.is_alive():
            response = post(client, GOOD)
            if response.status_code != 200:
                refused.append(response)
        thread.join()
        assert answers[0].status_code == 200
        assert refused
        for response in refused:
            assert_problem(response, 429)
            assert int(response.headers["retry-after"]) >= 1
        assert post(client, GOOD).status_code == 200


def test_limits_are_settings(model_store: Path) -> None:
    with serving(Settings(model_store=model_store, max_candidates=8)) as client:
        wait_until_ready(client)
        assert post(client, GOOD | {"num_candidates": 8}).status_code == 200
        assert_problem(post(client, GOOD | {"num_candidates": 9}), 422)


def test_the_types_of_problems_are_listed() -> None:
    page = Path(errors.__file__).with_name("README.md").read_text()
    listed = {
        (slug.strip(" `"), int(status))
        for line in page.partition("## Problems")[2].splitlines()
        if line.startswith("| `")
        for slugs, statuses, _ in [line.strip("| ").split(" | ", 2)]
        for slug in slugs.split(",")
        for status in statuses.split(",")
    }
    told = {(answer.slug, answer.status) for answer in errors.ANSWERS.values() if answer.slug}
    unread = {("malformed-http", status) for status in (400, 431, 501)} | {("no-websocket", 400)}
    assert listed == told | unread | {("invalid-request", 422)}
