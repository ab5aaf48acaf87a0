"""What answers hold where it is asked for: outline, denoising, errors, ensemble."""

from typing import Any

import httpx
import numpy as np
import pytest

from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from tests.api.test_errors import assert_problem
from tests.api.test_plan import plan, plan_multistep

RELATIVE = {"coulomb_friction": 0.1, "control_gain": 0.05}
DDIM = {"name": "action_diffusion", "sampler": "ddim", "steps": 6}


def test_nothing_is_sent_that_is_not_asked_for(client: httpx.Client) -> None:
    uncertainty = {"relative": RELATIVE, "num_systems": 8}
    answer = plan(client, method=DDIM, uncertainty=uncertainty)
    for name in ("candidates", "candidate_errors", "reachable_set", "denoising"):
        assert name not in answer
    assert not {"errors", "fan"} & answer["robustness"].keys()


def test_the_errors_of_candidates_come_without_the_candidates(client: httpx.Client) -> None:
    asked = {"method": "cem", "num_candidates": 9, "seed": 3}
    answer = plan(client, **asked, include=["candidate_errors"])
    whole = plan(client, **asked, include=["candidates"])
    assert answer["candidate_errors"] == whole["candidates"]["terminal_errors"]
    assert min(answer["candidate_errors"]) == answer["terminal_error"]


def test_the_reachable_set_holds_the_plans_end_and_not_what_is_out_of_reach(
    client: httpx.Client,
) -> None:
    answer = plan(client, method="dataset_prior", refine=True, include=["reachable_set"])
    ((low, high),) = answer["reachable_set"]["at_rest"]
    assert low < 0.2 < high
    beyond = plan(client, method="uniform", target_state=[high + 0.1, 0.0])
    assert beyond["reachability"]["floor"] > 0.05
    corners = np.concatenate([np.array(one) for one in answer["reachable_set"]["polygons"]])
    assert corners.shape[1] == 2


@pytest.mark.parametrize("refine", [False, True])
def test_denoising_goes_from_noise_to_the_candidates(client: httpx.Client, refine: bool) -> None:
    include = ["states", "candidates", "denoising"]
    answer = plan(client, method=DDIM, num_candidates=5, refine=refine, include=include)
    steps = answer["denoising"]
    controls = np.array(steps["controls"])
    assert controls.shape == (7, 5, 64)
    assert np.abs(controls[0]).max() > 0.9 >= np.abs(controls[-1]).max()
    states = rollout(System(), np.zeros(2), controls.clip(-0.9, 0.9).reshape(-1, 64))
    np.testing.assert_array_equal(np.array(steps["states"]).reshape(-1, 65, 2), states)
    errors = np.linalg.norm(states[:, -1] - [0.2, 0.0], axis=1)
    np.testing.assert_allclose(np.ravel(steps["terminal_errors"]), errors)
    if not refine:
        assert steps["controls"][-1] == answer["candidates"]["controls"]


def test_what_denoises_nothing_has_no_denoising(client: httpx.Client) -> None:
    assert "denoising" not in plan(client, method="cem", include=["denoising"])


def test_more_denoising_than_is_ever_sent_is_refused(client: httpx.Client) -> None:
    body: dict[str, Any] = {
        "initial_state": [0, 0],
        "target_state": [0.2, 0],
        "method": DDIM | {"steps": 50},
        "num_candidates": 200,
        "include": ["states", "denoising"],
    }
    problem = assert_problem(client.post("/plan", json=body), 422)
    assert problem["errors"][0]["pointer"] == "/include"
    assert "all steps of their denoising" in problem["errors"][0]["detail"]


def test_the_ensemble_is_what_the_plan_was_judged_on(client: httpx.Client) -> None:
    systems = [{"coulomb_friction": 0.5 + 0.01 * index} for index in range(10)]
    answer = plan(client, method="cem", uncertainty={"systems": systems}, include=["ensemble"])
    found = answer["robustness"]
    controls = np.array([answer["controls"]])
    states = [rollout(System(**one), np.zeros(2), controls)[0] for one in systems]
    np.testing.assert_allclose(found["fan"], states)
    errors = [np.linalg.norm(one[-1] - [0.2, 0.0]) for one in states]
    np.testing.assert_allclose(found["errors"], errors)
    assert found["mean_error"] == pytest.approx(np.mean(errors))


def test_a_plan_that_is_only_judged_is_the_one_without_uncertainty(client: httpx.Client) -> None:
    asked: dict[str, Any] = {"method": "dataset_prior", "refine": True, "seed": 4}
    uncertainty = {"relative": RELATIVE, "num_systems": 8, "num_motions": 64}
    nominal = plan(client, **asked, uncertainty=uncertainty | {"robust": False})
    assert nominal["controls"] == plan(client, **asked)["controls"]
    robust = plan(client, **asked, uncertainty=uncertainty)
    assert robust["robustness"]["mean_error"] < nominal["robustness"]["mean_error"]
    assert nominal["robustness"]["num_systems"] == robust["robustness"]["num_systems"] == 256


def test_each_segment_has_what_is_asked_for(client: httpx.Client) -> None:
    include = ["reachable_set", "candidate_errors"]
    answer = plan_multistep(client, method="cem", include=include)
    for segment in answer["segments"]:
        assert segment["reachable_set"]["polygons"]
        assert len(segment["candidate_errors"]) == 4
