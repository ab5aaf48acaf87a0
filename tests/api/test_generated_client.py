"""A client that openapi-python-client makes of the service's document, against the service."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import httpx
import pytest

PACKAGE = "generated_breakaway_client"
Import = Callable[[str], Any]


@pytest.fixture(scope="module")
def generated(client: httpx.Client, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Import]:
    """Import modules of a client that was generated without a single warning."""
    folder = tmp_path_factory.mktemp("generated")
    # Nothing is done to the code afterwards: the generator looks for ruff on the PATH.
    # Lines of JSON are text to it.
    (folder / "config.yml").write_text(
        "post_hooks: []\ncontent_type_overrides: {application/x-ndjson: text/plain}"
    )
    generate(str(client.base_url.join("/openapi.json")), folder)
    sys.path.insert(0, str(folder))
    yield lambda module: import_module(f"{PACKAGE}.{module}" if module else PACKAGE)
    sys.path.remove(str(folder))


def generate(url: str, folder: Path) -> None:
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--fail-on-warning"]
    options = ["--url", url, "--meta", "none", "--config", "config.yml", "--output-path", PACKAGE]
    made = subprocess.run(
        [*command, *options], cwd=folder, capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stdout + made.stderr


@pytest.fixture
def caller(generated: Import, client: httpx.Client) -> Iterator[Any]:
    with generated("").Client(base_url=str(client.base_url)) as caller:
        yield caller


def test_it_plans(generated: Import, caller: Any) -> None:
    models, plan = generated("models"), generated("api.planning.plan")
    request = models.PlanRequest(
        initial_state=[0.0, 0.0],
        target_state=[0.2, 0.0],
        method=models.CEM(iterations=3),
        refine=True,
        num_candidates=4,
        seed=7,
    )
    answer = plan.sync(client=caller, body=request)
    assert isinstance(answer, models.PlanResponse)
    assert answer.method == "cem"
    assert answer.seed == 7
    assert len(answer.controls) == 64
    assert answer.states[-1][0] == pytest.approx(0.2, abs=1e-6)
    assert answer.reachability.reachable


def test_the_default_method_is_planned_with(generated: Import, caller: Any) -> None:
    models, plan = generated("models"), generated("api.planning.plan")
    request = models.PlanRequest(initial_state=[0.0, 0.0], target_state=[0.2, 0.0])
    answer = plan.sync(client=caller, body=request)
    assert answer.method == "action_diffusion"
    assert answer.model.name == "tiny"


def test_it_plans_to_several_targets(generated: Import, caller: Any) -> None:
    models, plan_multistep = generated("models"), generated("api.planning.plan_multistep")
    targets = [[0.4, 0.0], [-0.4, 0.0]]
    request = models.MultistepPlanRequest(
        initial_state=[0.0, 0.0], targets=targets, method=models.DatasetPrior(), refine=True
    )
    answer = plan_multistep.sync(client=caller, body=request)
    assert isinstance(answer, models.MultistepPlanResponse)
    for segment, target in zip(answer.segments, targets, strict=True):
        assert segment.states[-1][0] == pytest.approx(target[0], abs=1e-6)


def test_it_plans_for_a_plant_by_numbers_objects_or_a_name(generated: Import, caller: Any) -> None:
    models, plan = generated("models"), generated("api.planning.plan")
    system = models.System(
        static_friction=models.ByDirection(forward=0.5, backward=0.8),
        coulomb_friction=0.4,
        stribeck_velocity=0.02,
        control_gain=0.5,
        control_limit=models.ControlLimits(lower=-4.0, upper=6.0),
    )
    for asked in (system, models.MachineName.EMPS):
        request = models.PlanRequest(
            initial_state=[0.0, 0.0],
            target_state=[0.01, 0.0],
            method=models.MethodName.DATASET_PRIOR,
            refine=True,
            system=asked,
            pending_controls=[1.0, 2.0],
        )
        answer = plan.sync(client=caller, body=request)
        assert isinstance(answer, models.PlanResponse), answer
        assert answer.predicted_initial_state == answer.states[0]
        assert isinstance(answer.system.static_friction, models.ByDirection)
        if asked is system:
            assert answer.system.coulomb_friction == 0.4
            assert answer.system.control_limit == system.control_limit


def test_a_bad_request_is_a_typed_problem(generated: Import, caller: Any) -> None:
    models, plan = generated("models"), generated("api.planning.plan")
    request = models.PlanRequest(
        initial_state=[0.0, 0.0], target_state=[0.2, 0.0], method=models.CEM(iterations=0)
    )
    answer = plan.sync_detailed(client=caller, body=request)
    assert answer.status_code == 422
    assert isinstance(answer.parsed, models.ProblemDetails)
    assert answer.parsed.type_ == "urn:breakaway:problem:invalid-request"
    (error,) = answer.parsed.errors
    assert isinstance(error, models.FieldError)
    assert error.pointer == "/method/iterations"


def test_it_asks_what_there_is(generated: Import, caller: Any) -> None:
    (model,) = generated("api.about.models").sync(client=caller)
    assert model.name == "tiny"
    assert generated("api.about.info").sync(client=caller).limits.max_candidates == 4096
    assert len(generated("api.about.methods").sync(client=caller)) == 6
    machines = generated("api.about.machines").sync(client=caller)
    assert {machine.name: machine.control_unit for machine in machines}["emps"] == "V"
    assert generated("api.health.readyz").sync(client=caller).status == "ready"
