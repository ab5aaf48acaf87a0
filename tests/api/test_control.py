"""Single steps and whole runs over HTTP, and that they and sessions are one and the same."""

import json
from typing import Any

import httpx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.control import CONTROLLERS, RecedingHorizon
from app.planning.control.simulation import ToldOf, TrueMachine, simulate
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.wire.control import ControlResponse
from app.wire.simulation import SimulateResponse
from tests.api.sessions import opened
from tests.api.test_errors import assert_problem

STEP = {"state": [0.0, 0.0], "target_state": [0.2, 0.0], "steps_left": 40}
TRUE = {"static_friction": 0.8, "coulomb_friction": 0.65}
RUN = {
    "initial_state": [0.0, 0.0],
    "target_state": [0.2, 0.0],
    "system": TRUE,
    "nominal_system": {},
    "controller": "receding_horizon",
    "steps_left": 40,
    "steps": 80,
    "disturbance": {
        "acceleration_noise": 0.05,
        "pulses": [{"first_step": 30, "steps": 5, "acceleration": 1.5}],
    },
    "sensor": {"position_noise": 1e-3, "velocity_noise": 1e-2},
    "delay_steps": 1,
    "seed": 7,
}

ENSEMBLE = {"relative": {"coulomb_friction": 0.1}}
UNCERTAIN = {"uncertainty": ENSEMBLE}


def ask(client: httpx.Client, path: str, body: dict[str, Any]) -> dict[str, Any]:
    answer = client.post(path, json=body)
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


@pytest.mark.parametrize("controller", [kind().name for kind in CONTROLLERS])
def test_a_step_moves_towards_the_target_and_says_what_it_believes(
    client: httpx.Client, controller: str
) -> None:
    answer = ask(client, "/control", STEP | {"controller": controller})
    step = ControlResponse.model_validate(answer)
    assert step.controller == controller
    assert step.control == step.plan[0] > 0.7
    assert step.status == "moving"
    assert len(step.predicted_states) == len(step.plan) + 1
    assert step.estimate.position == pytest.approx(0.0, abs=1e-3)
    assert step.seed is None


def test_a_fallback_is_drawn_by_the_seed(client: httpx.Client) -> None:
    # What the receding horizon reaches in no way is where the other method is asked.
    far = STEP | {"target_state": [5.0, 0.0], "fallback": {"method": "cem", "refine": True}}
    first, same = (ask(client, "/control", far | {"seed": 3}) for _ in range(2))
    assert first["seed"] == 3
    assert first["plan"] == same["plan"]
    assert "seed" in ask(client, "/control", far)


@pytest.mark.parametrize(
    "controls",
    [
        {"controller": "receding_horizon"},
        {"controller": {"name": "pid"}},
        {
            "controller": {"name": "receding_horizon", "replan_every": 8},
            "uncertainty": {"relative": {"coulomb_friction": 0.2}, "num_systems": 4},
            "seed": 7,
        },
    ],
    ids=["receding_horizon", "pid", "ensemble"],
)
def test_steps_that_are_carried_a_session_and_a_run_are_the_same(
    client: httpx.Client, controls: dict[str, Any]
) -> None:
    run = ask(client, "/simulate", RUN | controls)["runs"][0]
    asked = controls | {"target_state": [0.2, 0.0], "system": {}}
    pending, carry = [0.0], None
    with opened(client) as session:
        session.ask({"type": "start", "steps_left": 40, "pending_controls": [0.0], **asked})
        for k, (measured, control) in enumerate(
            zip(run["measurements"], run["controls"], strict=False)
        ):
            position, velocity = measured
            body = asked | {"state": measured, "steps_left": max(0, 40 - k)}
            body |= {"pending_controls": pending} | ({"carry": carry} if carry else {})
            step = ask(client, "/control", body)
            assert step.get("seed") == controls.get("seed")
            told = session.ask({"type": "measure", "position": position, "velocity": velocity})
            assert step["control"] == told["control"] == control, k
            assert step["status"] == told["status"]
            pending, carry = [control], step["carry"]


def test_an_ensemble_is_planned_for_as_the_domain_does(client: httpx.Client) -> None:
    systems = [{"coulomb_friction": friction} for friction in (0.5, 0.6, 0.7)]
    body = STEP | {"pending_controls": [0.9], "uncertainty": {"systems": systems}}
    robust = ask(client, "/control", body)
    assert "seed" not in robust
    taken = control_step(
        RecedingHorizon(),
        System(),
        Measurement(0.0, 0.0),
        Goal(0.2, 40),
        pending_controls=[0.9],
        ensemble=Ensemble.of([System(**system) for system in systems], np.zeros(2)),
    )
    assert robust["plan"] == taken.plan.tolist()
    assert robust["plan"] != ask(client, "/control", STEP | {"pending_controls": [0.9]})["plan"]


def test_a_run_is_what_the_domain_makes_of_it(client: httpx.Client) -> None:
    plain = {key: RUN[key] for key in ("initial_state", "target_state", "controller", "seed")}
    answer = ask(client, "/simulate", plain | {"system": TRUE, "nominal_system": {}, "num_runs": 3})
    runs = simulate(
        TrueMachine(System(0.8, 0.65)),
        (0.0, 0.0),
        CONTROLLERS[0](),
        ToldOf(System(), 0.2),
        128,
        range(7, 10),
    )
    assert [run["seed"] for run in answer["runs"]] == [7, 8, 9]
    for index, run in enumerate(answer["runs"]):
        assert run["controls"] == runs.controls[index].tolist()
        assert run["states"] == runs.states[index].tolist()
        assert run["final_error"] == runs.final_errors[index]
        assert run["settling_step"] == runs.settling_steps[index]
        assert run["status"] == "arrived"
    SimulateResponse.model_validate(answer)


def test_an_open_loop_misses_where_the_plant_is_another(client: httpx.Client) -> None:
    plan = ask(
        client,
        "/plan",
        {"initial_state": [0, 0], "target_state": [0.5, 0], "method": "dataset_prior"}
        | {"refine": True, "seed": 1},
    )
    body = {"initial_state": [0, 0], "controls": plan["controls"], "target_state": [0.5, 0]}
    exact = ask(client, "/simulate", body)["runs"][0]
    assert exact["final_error"] < 1e-6
    assert "status" not in exact
    off = ask(client, "/simulate", body | {"system": TRUE})["runs"][0]
    assert off["final_error"] > 0.05
    del body["target_state"]
    aimless = ask(client, "/simulate", body)["runs"][0]
    assert "final_error" not in aimless
    assert "settling_step" not in aimless


def test_what_is_not_measured_is_null(client: httpx.Client) -> None:
    body = RUN | {"sensor": {"measures_velocity": False}, "num_runs": 2}
    runs = ask(client, "/simulate", body)["runs"]
    assert {velocity for run in runs for _, velocity in run["measurements"]} == {None}
    assert all(run["final_error"] < 0.02 for run in runs)


@pytest.mark.parametrize(
    ("path", "changes", "pointer"),
    [
        ("/control", {"target_state": [0.2, 0.1]}, "/target_state"),
        ("/control", {"position": 0.1}, ""),
        ("/control", {"controller": "lqr"}, "/controller"),
        (
            "/control",
            {"controller": {"name": "pd", "proportional": -1}},
            "/controller/proportional",
        ),
        ("/control", {"pending_controls": [2.0]}, "/pending_controls/0"),
        ("/control", {"carry": {}}, "/carry/version"),
        ("/control", {"carry": [1]}, "/carry"),
        ("/control", {"fallback": {"method": "action_diffusion"}}, "/fallback/method"),
        (
            "/control",
            {"fallback": {"method": "cem", "num_candidates": 5000}},
            "/fallback/num_candidates",
        ),
        ("/control", {"controller": "pd", "uncertainty": ENSEMBLE}, "/uncertainty"),
        ("/control", {"uncertainty": ENSEMBLE, "fallback": {"method": "cem"}}, "/fallback"),
        ("/control", {"uncertainty": {"systems": []}}, "/uncertainty/systems"),
        (
            "/control",
            {"uncertainty": {"systems": [{"time_step": 0.01}]}},
            "/uncertainty/systems/0/time_step",
        ),
        ("/simulate", {"controller": None, "controls": [0.1]} | UNCERTAIN, "/uncertainty"),
        ("/simulate", {"uncertainty": {"risk": "mean"}}, "/uncertainty/risk"),
        (
            "/control",
            {"state": None, "position": 0.0, "controller": {"name": "pd", "observer": None}},
            "/position",
        ),
        ("/simulate", {"controls": [0.1]}, ""),
        ("/simulate", {"target_state": None}, ""),
        ("/simulate", {"nominal_system": {"time_step": 0.01}}, "/nominal_system/time_step"),
        ("/simulate", {"nominal_system": {"control_limit": 2}}, "/nominal_system/control_limit"),
        ("/simulate", {"controller": None, "controls": [0.5, 1.0]}, "/controls/1"),
        ("/simulate", {"steps": 100_000, "num_runs": 100}, "/num_runs"),
        ("/simulate", {"num_runs": 0}, "/num_runs"),
        ("/simulate", {"deadline_ms": 10**9}, "/deadline_ms"),
        ("/simulate", {"disturbance": {"pulses": [{}]}}, "/disturbance/pulses/0/first_step"),
        (
            "/simulate",
            {
                "controller": {"name": "pd", "observer": None},
                "sensor": {"measures_velocity": False},
            },
            "/sensor/measures_velocity",
        ),
    ],
)
def test_what_cannot_be_done_is_the_field_s_fault(
    client: httpx.Client, path: str, changes: dict[str, Any], pointer: str
) -> None:
    body = (STEP if path == "/control" else RUN) | changes
    problem = assert_problem(client.post(path, json=body), 422)
    assert pointer in [error["pointer"] for error in problem["errors"]]


def test_who_has_no_time_is_refused(client: httpx.Client) -> None:
    body = RUN | {"num_runs": 300, "steps": 400, "include": [], "deadline_ms": 1}
    assert client.post("/simulate", json=body).status_code in (429, 504)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)


@given(st.data())
@settings(max_examples=60)
def test_a_carry_that_was_tampered_with_never_breaks_the_service(
    client: httpx.Client, data: st.DataObject
) -> None:
    carry = ask(client, "/control", STEP)["carry"]
    field = data.draw(st.sampled_from([*carry, "other"]))
    value = carry.get(field)
    if isinstance(value, list) and value and data.draw(st.booleans()):
        index = data.draw(st.integers(0, len(value) - 1))
        number = st.floats() | st.sampled_from([-1e6, 1e6, 0.0, 1e300])
        carry[field] = [*value[:index], data.draw(number), *value[index + 1 :]]
    else:
        carry[field] = data.draw(JSON)
    text = json.dumps(STEP | {"state": [0.01, 0.1], "carry": carry})
    answer = client.post("/control", content=text, headers={"Content-Type": "application/json"})
    assert answer.status_code in (200, 422), answer.text
