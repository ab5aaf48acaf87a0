"""`POST /plan` and `POST /plan_multistep` over real HTTP: what a good request gets."""

import itertools
import threading
from dataclasses import asdict
from typing import Any

import httpx
import numpy as np
import pytest
from pydantic import TypeAdapter

from app.planning.plant.machines import MACHINES
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System

METHODS = ["action_diffusion", "dataset_prior", "uniform", "cem", "icem", "mppi"]


def plan(client: httpx.Client, **fields: Any) -> dict[str, Any]:
    body = {"initial_state": [0.0, 0.0], "target_state": [0.2, 0.0], "num_candidates": 4, **fields}
    response = client.post("/plan", json=body)
    assert response.status_code == 200, response.text
    answer: dict[str, Any] = response.json()
    return answer


def plan_multistep(client: httpx.Client, **fields: Any) -> dict[str, Any]:
    body = {
        "initial_state": [0.1, 0.0],
        "targets": [[0.4, 0.0], [-0.4, 0.0], [0.2, 0.0]],
        "num_candidates": 4,
        **fields,
    }
    response = client.post("/plan_multistep", json=body)
    assert response.status_code == 200, response.text
    answer: dict[str, Any] = response.json()
    return answer


def without_timing(answer: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in answer.items() if key != "timing_ms"}
    if "segments" in kept:
        kept["segments"] = [without_timing(segment) for segment in kept["segments"]]
    return kept


@pytest.mark.parametrize("method", METHODS)
def test_the_plan_answered_is_the_plan_rolled_out(client: httpx.Client, method: str) -> None:
    answer = plan(
        client, method=method, initial_state=[0.3, -0.2], include=["states", "candidates"]
    )
    states = rollout(System(), np.array([0.3, -0.2]), np.array([answer["controls"]]))[0]
    np.testing.assert_array_equal(states, answer["states"])
    error = np.hypot(states[-1, 0] - 0.2, states[-1, 1])
    assert answer["terminal_error"] == pytest.approx(error, abs=1e-12)
    assert answer["control_energy"] == pytest.approx(np.sum(np.square(answer["controls"])))
    smoothness = np.sum(np.square(np.diff(answer["controls"])))
    assert answer["control_smoothness"] == pytest.approx(smoothness)
    assert answer["terminal_error"] == min(answer["candidates"]["terminal_errors"])
    assert answer["controls"] in answer["candidates"]["controls"]
    assert np.shape(answer["candidates"]["states"]) == (4, 65, 2)
    assert np.abs(answer["candidates"]["controls"]).max() <= 0.9


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_plan(client: httpx.Client, method: str) -> None:
    first, again, other = (plan(client, method=method, seed=seed) for seed in (7, 7, 8))
    assert without_timing(first) == without_timing(again)
    assert first["controls"] != other["controls"]


def test_a_drawn_seed_asks_for_the_same_plan_again(client: httpx.Client) -> None:
    drawn = plan(client, method="dataset_prior")
    assert plan(client, method="dataset_prior")["seed"] != drawn["seed"]
    again = plan(client, method="dataset_prior", seed=drawn["seed"])
    assert without_timing(again) == without_timing(drawn)


def test_only_the_states_are_required(client: httpx.Client) -> None:
    answer = client.post("/plan", json={"initial_state": [0, 0], "target_state": [0.2, 0]}).json()
    assert answer["method"] == "action_diffusion"
    assert answer["model"]["name"] == "tiny"
    assert answer["model"]["version"] == "1"
    assert len(answer["model"]["sha256"]) == 64
    assert len(answer["controls"]) == 64
    assert np.shape(answer["states"]) == (65, 2)
    assert "candidates" not in answer
    assert set(answer["timing_ms"]) == {"queue", "propose", "refine", "rollout", "total"}


def test_guidance_costs_a_second_prediction_only_where_it_is_used(client: httpx.Client) -> None:
    def evaluations(**options: Any) -> int:
        answer = plan(client, method={"name": "action_diffusion", **options})
        count: int = answer["cost"]["network_evaluations"]
        return count

    assert evaluations() == 6
    assert evaluations(guidance_scale=1.0) == 3
    assert evaluations(steps=10, guidance_scale=1.5) == 20
    assert evaluations(sampler="ddim") == 20
    assert evaluations(sampler="paper") == 100


def test_the_sampler_of_the_paper_is_ddim_with_its_settings(client: httpx.Client) -> None:
    spelt_out = {"sampler": "ddim", "steps": 50, "guidance_scale": 2.0}
    paper, ddim = (
        without_timing(plan(client, method={"name": "action_diffusion", **options}, seed=7))
        for options in ({"sampler": "paper"}, spelt_out)
    )
    assert paper == ddim


@pytest.mark.parametrize("sampler", ["dpm_solver", "ddim", "paper"])
def test_the_same_seed_gives_the_same_plan_by_each_sampler(
    client: httpx.Client, sampler: str
) -> None:
    method = {"name": "action_diffusion", "sampler": sampler}
    first, again, other = (plan(client, method=method, seed=seed) for seed in (7, 7, 8))
    assert without_timing(first) == without_timing(again)
    assert first["controls"] != other["controls"]


@pytest.mark.parametrize(
    ("sampler", "steps"),
    [*(("ddim", n) for n in (1, 2, 3, 7, 199, 200)), *(("dpm_solver", n) for n in (1, 2, 90, 91))],
)
def test_every_step_count_ends_in_usable_controls(
    client: httpx.Client, sampler: str, steps: int
) -> None:
    answer = plan(client, method={"name": "action_diffusion", "sampler": sampler, "steps": steps})
    assert np.abs(answer["controls"]).max() <= 0.9


def test_options_of_a_method_reach_it(client: httpx.Client) -> None:
    answer = plan(client, method={"name": "cem", "iterations": 3})
    assert answer["cost"] == {"network_evaluations": 0, "rollouts": 3 * 4 + 4}
    calm = {"kick_probability": 0.0, "medium_probability": 0.0}
    answer = plan(client, method={"name": "dataset_prior", "prior": calm})
    assert np.abs(answer["controls"]).max() <= 0.15 * 0.9


def test_another_plant_is_planned_with(client: httpx.Client) -> None:
    system = {"static_friction": 0.5, "coulomb_friction": 0.2, "control_limit": 2.0}
    answer = plan(client, method="cem", system=system, horizon=20, num_candidates=32)
    assert answer["system"] == {
        "viscous_damping": 0.05,
        "bias": 0.0,
        "control_gain": 1.0,
        "time_step": 0.05,
        "velocity_threshold": 1e-3,
        **system,
    }
    states = rollout(System(**system), np.zeros(2), np.array([answer["controls"]]))[0]
    np.testing.assert_array_equal(states, answer["states"])
    assert len(answer["controls"]) == 20


def test_a_plant_that_differs_by_direction_is_planned_with(client: httpx.Client) -> None:
    system = {
        "static_friction": {"forward": 0.5, "backward": 0.8},
        "coulomb_friction": {"forward": 0.4, "backward": 0.8},
        "viscous_damping": 0.1,
        "stribeck_velocity": 0.02,
        "bias": -0.1,
        "control_gain": 0.5,
        "control_limit": {"lower": -4.0, "upper": 6.0},
        "time_step": 0.02,
        "velocity_threshold": 1e-3,
    }
    answer = plan(client, method="dataset_prior", system=system, refine=True)
    assert answer["system"] == system
    plant = TypeAdapter(System).validate_python(system)
    states = rollout(plant, np.zeros(2), np.array([answer["controls"]]))[0]
    np.testing.assert_array_equal(states, answer["states"])
    assert -4 <= min(answer["controls"]) <= max(answer["controls"]) <= 6
    assert 0 < answer["reachability"]["floor_error"] < 1e-5
    assert plan(client, method="dataset_prior")["reachability"]["floor_error"] == 0


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_is_planned_for_by_its_name(client: httpx.Client, name: str) -> None:
    named, spelt_out = (
        plan(client, method="dataset_prior", seed=1, target_state=[0.01, 0.0], system=system)
        for system in (name, asdict(MACHINES[name].system))
    )
    assert without_timing(named) == without_timing(spelt_out)
    assert "stribeck_velocity" in named["system"] or not MACHINES[name].system.stribeck_velocity


PENDING = {"pending_controls": [0.9, 0.9, 0.9, -0.9, 0.0], "initial_state": [0.1, -0.2]}


@pytest.mark.parametrize("method", METHODS)
def test_a_plan_starts_where_the_pending_controls_lead_to(
    client: httpx.Client, method: str
) -> None:
    answer = plan(client, method=method, seed=1, **PENDING)
    states = rollout(
        System(),
        np.array([0.1, -0.2]),
        np.array([[*PENDING["pending_controls"], *answer["controls"]]]),
    )[0]
    np.testing.assert_array_equal(states[5:], answer["states"])
    assert answer.pop("predicted_initial_state") == answer["states"][0] == states[5].tolist()
    from_there = plan(client, method=method, seed=1, initial_state=answer["states"][0])
    assert without_timing(answer) == without_timing(from_there)


def test_pending_controls_come_before_the_first_segment(client: httpx.Client) -> None:
    answer = plan_multistep(client, method="cem", seed=1, **PENDING)
    predicted = answer.pop("predicted_initial_state")
    assert answer["states"][0] == answer["segments"][0]["states"][0] == predicted
    from_there = plan_multistep(client, method="cem", seed=1, initial_state=predicted)
    assert without_timing(answer) == without_timing(from_there)
    assert "predicted_initial_state" not in answer["segments"][0]


def test_without_pending_controls_nothing_is_predicted(client: httpx.Client) -> None:
    assert "predicted_initial_state" not in plan(client, method="cem", pending_controls=[])


def test_controls_at_the_very_limits_may_be_pending(client: httpx.Client) -> None:
    limits = {"control_limit": {"lower": -1.5, "upper": 2.0}}
    answer = plan(client, method="cem", system=limits, pending_controls=[2.0, -1.5] * 512)
    assert answer["states"][0] == answer["predicted_initial_state"]


def test_a_model_can_be_named_with_and_without_its_version(client: httpx.Client) -> None:
    for name in ("tiny", "tiny/1"):
        assert plan(client, model=name)["model"]["name"] == "tiny"


@pytest.mark.parametrize("method", METHODS)
def test_segments_follow_one_another(client: httpx.Client, method: str) -> None:
    answer = plan_multistep(client, method=method, seed=3)
    segments = answer["segments"]
    assert len(segments) == 3
    assert segments[0]["states"][0] == [0.1, 0.0]
    for before, after in itertools.pairwise(segments):
        assert after["states"][0] == before["states"][-1]
    assert answer["controls"] == [u for segment in segments for u in segment["controls"]]
    assert answer["states"][-1] == segments[-1]["states"][-1]
    assert len(answer["states"]) == 3 * 64 + 1
    errors = [segment["terminal_error"] for segment in segments]
    assert answer["final_error"] == errors[-1]
    assert answer["mean_end_error"] == pytest.approx(np.mean(errors))
    assert answer["stuck_steps"] == sum(segment["stuck_steps"] for segment in segments)
    assert without_timing(answer) == without_timing(plan_multistep(client, method=method, seed=3))


def test_states_are_left_out_when_not_asked_for(client: httpx.Client) -> None:
    assert "states" not in plan(client, method="cem", include=[])
    answer = plan_multistep(client, method="cem", include=["candidates"])
    assert "states" not in answer
    assert "states" not in answer["segments"][0]["candidates"]
    assert np.shape(answer["segments"][0]["candidates"]["controls"]) == (4, 64)


def test_livez_answers_while_a_large_plan_runs(client: httpx.Client) -> None:
    answers: list[dict[str, Any]] = []
    large = {"name": "action_diffusion", "sampler": "ddim", "steps": 100}
    thread = threading.Thread(
        target=lambda: answers.append(plan(client, method=large, num_candidates=512))
    )
    thread.start()
    alive_meanwhile = 0
    while thread.is_alive():
        assert client.get("/livez").json() == {"status": "alive"}
        alive_meanwhile += thread.is_alive()
    thread.join()
    assert alive_meanwhile >= 3
    assert len(answers) == 1


def test_compiled_methods_do_not_wait_for_the_network(client: httpx.Client) -> None:
    large = {"name": "action_diffusion", "sampler": "paper"}
    thread = threading.Thread(target=lambda: plan(client, method=large, num_candidates=512))
    thread.start()
    plan(client, method="cem")
    assert thread.is_alive()
    thread.join()


@pytest.mark.parametrize("method", METHODS)
def test_a_refined_plan_arrives_and_says_what_it_was_before(
    client: httpx.Client, method: str
) -> None:
    plain = plan(client, method=method, seed=1)
    refined = plan(client, method=method, seed=1, refine=True)
    assert plain["gap"] == pytest.approx(plain["terminal_error"], abs=1e-9)
    assert "refinement" not in plain
    assert refined["refinement"]["error_before"] == pytest.approx(plain["terminal_error"])
    assert refined["refinement"]["error_after"] == refined["terminal_error"]
    assert refined["terminal_error"] < 1e-6
    states = rollout(System(), np.zeros(2), np.array([refined["controls"]]))[0]
    np.testing.assert_array_equal(states, refined["states"])


def test_every_plan_says_what_can_be_reached(client: httpx.Client) -> None:
    near = plan(client, method="cem")["reachability"]
    assert near.keys() == {"reachable", "floor", "floor_error", "nearest_state", "minimum_steps"}
    assert near["reachable"] is True
    assert near["floor"] == pytest.approx(0.0, abs=1e-9)
    assert 0 < near["minimum_steps"] < 64
    far = plan(client, method="dataset_prior", target_state=[2.0, 0.0], refine=True)
    assert far["reachability"]["reachable"] is False
    assert "minimum_steps" not in far["reachability"]
    distance = np.hypot(far["reachability"]["nearest_state"][0] - 2.0, 0.0)
    assert far["reachability"]["floor"] >= distance - 1e-9
    assert far["gap"] == pytest.approx(far["terminal_error"] - far["reachability"]["floor"])
    assert far["gap"] < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_a_plan_without_its_floor_is_the_same_plan(client: httpx.Client, method: str) -> None:
    options: dict[str, Any] = {"method": method, "refine": True, "seed": 2, "include": ["states"]}
    bounded = without_timing(plan(client, **options))
    bare = without_timing(plan(client, reachability=False, **options))
    assert {"gap", "reachability"} <= bounded.keys()
    assert bare == {
        name: value for name, value in bounded.items() if name not in ("gap", "reachability")
    }


def test_segments_without_their_floors_are_the_same_segments(client: httpx.Client) -> None:
    bounded = plan_multistep(client, method="dataset_prior", refine=True, seed=3)
    bare = plan_multistep(client, method="dataset_prior", refine=True, seed=3, reachability=False)
    assert "mean_end_floor" not in bare
    assert bare["mean_end_error"] == bounded["mean_end_error"]
    for segment, with_floor in zip(bare["segments"], bounded["segments"], strict=True):
        assert not {"gap", "reachability"} & segment.keys()
        assert segment["controls"] == with_floor["controls"]


def test_an_objective_chooses_among_plans_that_arrive(client: httpx.Client) -> None:
    options: dict[str, Any] = {"method": "dataset_prior", "refine": True, "seed": 1}
    plain = plan(client, **options)
    thrifty = plan(client, objective="control_energy", **options)
    assert thrifty["terminal_error"] < 2e-6
    assert thrifty["control_energy"] < plain["control_energy"]


def test_refinement_takes_options(client: httpx.Client) -> None:
    far = {"target_state": [0.8, 0.0], "method": "uniform", "num_candidates": 1, "seed": 1}
    repaired = plan(client, refine={"iterations": 20}, **far)
    bare = plan(client, refine={"iterations": 20, "repair": False}, **far)
    assert repaired["terminal_error"] < 1e-6
    assert repaired["refinement"]["replaced"]
    assert not bare["refinement"]["replaced"]
    assert "refinement" not in plan(client, refine=False, **far)


def test_segments_of_a_refined_plan_stand_beside_their_floors(client: httpx.Client) -> None:
    answer = plan_multistep(client, method="dataset_prior", refine=True, seed=3)
    floors = [segment["reachability"]["floor"] for segment in answer["segments"]]
    assert answer["mean_end_floor"] == pytest.approx(np.mean(floors))
    assert answer["mean_end_error"] == pytest.approx(answer["mean_end_floor"], abs=1e-6)


@pytest.mark.parametrize("optimiser", ["cem", "icem", "mppi"])
@pytest.mark.parametrize("initial", ["action_diffusion", "dataset_prior"])
def test_an_optimiser_starts_from_the_candidates_of_another_method(
    client: httpx.Client, optimiser: str, initial: str
) -> None:
    first = plan(client, method=initial, seed=5)
    started = plan(client, method=optimiser, initial={"method": initial}, seed=5)
    assert started["method"] == optimiser
    assert started["terminal_error"] <= first["terminal_error"] + 1e-9
    assert ("model" in started) == (initial == "action_diffusion")
    assert started["cost"]["network_evaluations"] == first["cost"]["network_evaluations"]
    assert started["cost"]["rollouts"] > first["cost"]["rollouts"]


RELATIVE = {"static_friction": 0.1, "coulomb_friction": 0.1, "control_gain": 0.05}


@pytest.mark.parametrize("refine", [False, True])
@pytest.mark.parametrize("risk", ["mean", "worst", {"cvar": 0.5}])
def test_given_plants_that_may_be_the_true_one_are_planned_for(
    client: httpx.Client, refine: bool, risk: Any
) -> None:
    systems = [System(coulomb_friction=0.6 * f, control_gain=g) for f in (0.9, 1.1) for g in (1, 2)]
    asked = {"method": "dataset_prior", "refine": refine, "seed": 5, "pending_controls": [0.9] * 4}
    uncertainty = {"systems": [asdict(s) for s in systems], "risk": risk, "num_motions": 64}
    answer = plan(client, **asked, uncertainty=uncertainty)
    nominal = plan(client, **asked)

    def risk_of(controls: list[float]) -> float:
        sequence = np.array([[0.9] * 4 + controls])
        ends = [rollout(system, np.zeros(2), sequence)[0, -1] for system in systems]
        errors = np.sort([np.hypot(p - 0.2, v) for p, v in ends])
        return float({"mean": errors, "worst": errors[-1:]}.get(str(risk), errors[-2:]).mean())

    robustness = answer["robustness"]
    assert robustness["risk"] == risk
    assert robustness["num_systems"] == 4
    assert robustness["value"] == pytest.approx(risk_of(answer["controls"]))
    assert robustness["value"] <= risk_of(nominal["controls"])
    assert robustness["nominal_error"] == answer["terminal_error"]
    assert "first_order_bound" not in robustness
    assert "robustness" not in nominal


def test_plants_are_drawn_from_the_seed_and_the_least_error_is_told(client: httpx.Client) -> None:
    uncertainty = {"relative": RELATIVE, "num_systems": 8, "num_motions": 64}
    asked = {"method": "dataset_prior", "refine": True, "uncertainty": uncertainty}
    answer = plan(client, **asked, seed=5)

    assert without_timing(answer) == without_timing(plan(client, **asked, seed=5))
    robustness = answer["robustness"]
    assert robustness["num_systems"] == 256
    assert robustness["value"] == pytest.approx(robustness["mean_error"])
    assert robustness["first_order_bound"] == pytest.approx(0.2 * 0.0258199, rel=1e-4)
    assert robustness["rms_error"] > 0.9 * robustness["first_order_bound"]
    assert set(robustness["within"]) == {"0.01", "0.05"}


@pytest.mark.parametrize("method", ["dataset_prior", "action_diffusion"])
def test_every_segment_is_judged_from_where_each_plant_is(
    client: httpx.Client, method: str
) -> None:
    uncertainty = {"relative": RELATIVE, "num_systems": 8, "num_motions": 64}
    answer = plan_multistep(client, method=method, refine=True, uncertainty=uncertainty, seed=5)
    first, *others = (segment["robustness"] for segment in answer["segments"])
    assert "first_order_bound" in first
    assert all("first_order_bound" not in other for other in others)


@pytest.mark.parametrize(
    ("uncertainty", "pointer"),
    [
        ({}, "/uncertainty"),
        ({"relative": {}, "systems": [{}]}, "/uncertainty"),
        ({"systems": []}, "/uncertainty/systems"),
        ({"systems": [{"time_step": 0.01}]}, "/uncertainty/systems/0/time_step"),
        ({"systems": [{"coulomb_friction": 2}]}, "/uncertainty/systems/0"),
        ({"relative": {"friction": 0.1}}, "/uncertainty/relative/friction"),
        ({"relative": {"bias": 1}}, "/uncertainty/relative/bias"),
        ({"relative": {}, "risk": {"cvar": 1.5}}, "/uncertainty/risk/cvar"),
        ({"relative": {}, "risk": "median"}, "/uncertainty/risk"),
        ({"relative": {}, "num_systems": 129}, "/uncertainty/num_systems"),
        ({"relative": {}, "num_motions": 0}, "/uncertainty/num_motions"),
    ],
)
def test_what_no_uncertainty_can_be_is_pointed_at(
    client: httpx.Client, uncertainty: dict[str, Any], pointer: str
) -> None:
    body = {"initial_state": [0, 0], "target_state": [0.2, 0], "method": "dataset_prior"}
    response = client.post("/plan", json=body | {"uncertainty": uncertainty})
    assert response.status_code == 422
    assert pointer in [error["pointer"] for error in response.json()["errors"]]
