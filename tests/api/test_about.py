"""The other routes: health, models, methods, info, documentation."""

import json
import re
import shutil
from pathlib import Path

import httpx

from app.planning.plant.machines import MACHINES
from app.settings import Settings
from app.wire.requests import PlanRequest
from tests.served import serving, wait_until_ready


def test_the_service_is_alive_before_it_is_ready(model_store: Path) -> None:
    with serving(Settings(model_store=model_store)) as client:
        assert client.get("/livez").json() == {"status": "alive"}
        early = client.get("/readyz")
        assert early.status_code == 503
        assert early.headers["content-type"] == "application/problem+json"
        assert "starting" in early.json()["detail"]
        body = {"initial_state": [0, 0], "target_state": [0.2, 0]}
        assert client.post("/plan", json=body).status_code == 503
        wait_until_ready(client)
        assert client.get("/readyz").json() == {"status": "ready"}
        assert client.post("/plan", json=body).status_code == 200


def test_a_tampered_model_is_never_served(model_store: Path, tmp_path: Path) -> None:
    shutil.copytree(model_store, tmp_path, dirs_exist_ok=True)
    checkpoint = tmp_path / "tiny" / "1" / "unet.pt"
    checkpoint.write_bytes(checkpoint.read_bytes()[:-1] + b"x")
    with serving(Settings(model_store=tmp_path)) as client:
        detail = ""
        while "starting" in (detail := client.get("/readyz").json()["detail"]):
            pass
        assert "sha256" in detail
        assert client.get("/livez").status_code == 200
        assert client.get("/models").status_code == 503


def test_models_are_listed_with_what_they_are_for(client: httpx.Client) -> None:
    (model,) = client.get("/models").json()
    assert model["name"] == "tiny"
    assert model["version"] == "1"
    assert model["plants"].startswith("static_friction 0.7, coulomb_friction 0.6,")
    assert model["coverage"]["ranges"]["static_forward"] == [0.7, 0.7]
    assert model["system"]["static_friction"] == 0.7
    assert model["trained_on"]
    assert model["predicts"] == "noise"
    assert model["horizon"] == 64
    samplers = model["samplers"]
    assert samplers.keys() == {"dpm_solver", "ddim"}
    assert samplers["ddim"].keys() == {"steps", "guidance_scale", "first_time", "last_time"}
    assert model["diffusion_timesteps"] == 200


def test_every_method_listed_can_be_asked_for_by_name_and_by_default_options(
    client: httpx.Client,
) -> None:
    methods = client.get("/methods").json()
    assert [method["name"] for method in methods] == [
        "action_diffusion",
        "dataset_prior",
        "uniform",
        "cem",
        "icem",
        "mppi",
    ]
    for method in methods:
        defaults = {
            name: option["default"]
            for name, option in method["options"]["properties"].items()
            if "default" in option
        }
        for asked in (method["name"], defaults):
            body = {"initial_state": [0, 0], "target_state": [0.2, 0], "method": asked}
            assert client.post("/plan", json=body | {"num_candidates": 2}).status_code == 200


def test_the_machines_are_listed_and_can_be_planned_for(client: httpx.Client) -> None:
    machines = client.get("/machines").json()
    assert [machine["name"] for machine in machines] == list(MACHINES)
    for machine in machines:
        body = {"initial_state": [0, 0], "target_state": [0.01, 0], "method": "cem", "seed": 1}
        system = client.post("/plan", json=body | {"system": machine["name"]}).json()["system"]
        assert machine.pop("system") == system
        expected = MACHINES[machine["name"]]
        assert machine == {name: getattr(expected, name) for name in machine}
        assert {"title", "position_unit", "control_unit", "delay_steps", "source"} < set(machine)


def test_every_parameter_of_a_plant_is_documented_with_its_unit(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    for name, units in (
        ("System", ("m/s^2", "m/s", "1/s", " s.", "units of control")),
        ("ByDirection", ("unit",)),
        ("ControlLimits", ("Units of control",)),
    ):
        assert schemas[name]["description"]
        for field, schema in schemas[name]["properties"].items():
            assert any(unit in schema["description"] for unit in units), field
    names = schemas["MachineName"]["enum"]
    assert names == list(MACHINES)


def test_info_says_what_runs_and_what_is_allowed(client: httpx.Client) -> None:
    info = client.get("/info").json()
    assert info["version"]
    assert info["limits"]["max_candidates"] == Settings().max_candidates
    assert info["libraries"]["torch"].startswith("2.13")


def test_the_documentation_needs_nothing_from_elsewhere(client: httpx.Client) -> None:
    page = client.get("/docs")
    assert page.status_code == 200
    addresses = re.findall(r"(?:href=|src=|url: )[\"']([^\"']+)[\"']", page.text)
    assert len(addresses) == 4
    for address in addresses:
        assert "//" not in address
        assert client.get(f"/{address}").status_code == 200


def test_the_examples_of_the_documentation_work(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    for path, schema in (("/plan", "PlanRequest"), ("/plan_multistep", "MultistepPlanRequest")):
        (example,) = schemas[schema]["examples"]
        response = client.post(path, content=json.dumps(example), headers=JSON)
        assert response.status_code == 200, response.text
    PlanRequest.model_validate(schemas["PlanRequest"]["examples"][0])


def test_documented_answers_include_the_problems(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    for path in ("/plan", "/plan_multistep"):
        responses = paths[path]["post"]["responses"]
        assert {"200", "400", "404", "413", "422", "429", "503"} <= set(responses)
        for status, response in responses.items():
            expected = {"application/json"} if status == "200" else {"application/problem+json"}
            if status == "200" and path == "/plan_multistep":
                expected |= {"text/event-stream"}
            assert set(response["content"]) == expected


JSON = {"Content-Type": "application/json"}
