import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from app.inference.conditioning import Conditioning
from app.inference.manifest import MANIFEST_FILE, Manifest
from app.planning.methods import ActionDiffusion
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS
from app.planning.plant.coverage import Coverage
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.settings import SHIPPED_MODELS
from tests.inference.conftest import SAMPLERS

RANGES = Coverage.only(System()).ranges
ANY = Coverage({"static_forward_over_limit": (0.02, 0.9), "displacement_over_reach": (-1.1, 1.1)})
CONDITION = Conditioning.on_states((0.1, 0.2), (0.8, 0.4)).model_dump()
VERSION_1 = {
    "format_version": 1,
    "system": {"static_friction": 0.6, "coulomb_friction": 0.5, "control_limit": 1.5},
    "control_scale": 1.5,
    "state_mean": [0.1, 0.2],
    "state_std": [0.8, 0.4],
}
"""What the first format has in place of `NEW`."""
NEW = ("coverage", "trained_on", "kind", "condition", "uncertainty", "predicts", "samplers")


def edit(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.fixture
def manifest_file(publish: Callable[..., Path]) -> Path:
    return publish() / MANIFEST_FILE


def test_what_was_written_is_what_is_read(publish: Callable[..., Path]) -> None:
    samplers = replace(SAMPLERS, dpm_solver=replace(SAMPLERS.ddim, first_time=0.1 + 0.7, steps=2))
    condition = Conditioning(features=("target_position",), mean=(0.1,), std=(0.1 + 0.2,))
    directory = publish(
        "slippery",
        3,
        coverage=ANY,
        system=MACHINES["emps"].system,
        trained_on="Expert plans.",
        condition=condition,
        predicts="velocity",
        samplers=samplers,
        horizon=32,
        alphas_cumprod=(0.9, 0.8, 0.7, 0.1 + 0.2),
    )

    manifest = Manifest.read(directory / MANIFEST_FILE)

    assert (manifest.name, manifest.version, manifest.horizon) == ("slippery", 3, 32)
    assert manifest.format_version == 2
    assert manifest.coverage == ANY
    assert manifest.system == MACHINES["emps"].system
    assert manifest.trained_on == "Expert plans."
    assert manifest.samplers == samplers
    assert manifest.alphas_cumprod == (0.9, 0.8, 0.7, 0.1 + 0.2)
    assert manifest.condition == condition
    assert manifest.predicts == "velocity"
    assert (manifest.losses.training, manifest.losses.validation) == (0.1, 0.2)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("format_version", 3),
        ("name", "../escape"),
        ("name", "Upper"),
        ("name", ""),
        ("version", 0),
        ("sha256", "abc"),
        ("coverage", {"static_forward": [0.5, 0.8]}),
        ("coverage", {"ranges": {}}),
        ("coverage", {"ranges": {"displacement_over_reach": [-1.0, 1.0]}}),
        ("coverage", {"ranges": RANGES | {"mass": [1.0, 1.0]}}),
        ("coverage", {"ranges": RANGES | {"static_forward": [0.8, 0.6]}}),
        ("coverage", {"ranges": RANGES | {"static_forward": [0.8, 0.9]}}),
        ("coverage", {"ranges": RANGES | {"static_forward": [0.7]}}),
        ("system", {"static_friction": 0.71}),
        ("predicts", "score"),
        ("trained_on", ""),
        ("samplers", {"ddim": asdict(SAMPLERS.ddim)}),
        ("samplers", asdict(SAMPLERS) | {"ddim": asdict(SAMPLERS.ddim) | {"steps": 21}}),
        ("samplers", asdict(SAMPLERS) | {"ddim": asdict(SAMPLERS.ddim) | {"last_time": 1.1}}),
        ("samplers", asdict(SAMPLERS) | {"ddim": asdict(SAMPLERS.ddim) | {"first_time": -0.1}}),
        (
            "samplers",
            asdict(SAMPLERS)
            | {"dpm_solver": asdict(SAMPLERS.ddim) | {"last_time": 1.0, "first_time": 0.5}},
        ),
        ("horizon", 0),
        ("control_scale", 0.9),
        ("condition", CONDITION | {"std": [0.8, 0.4, 0.0, 0.4]}),
        ("condition", CONDITION | {"std": [0.8, 0.4, 0.8]}),
        ("condition", CONDITION | {"mean": [float("nan"), 0.2, 0.1, 0.2]}),
        ("condition", CONDITION | {"features": ["initial_position", "mass"]}),
        ("condition", {"features": [], "mean": [], "std": []}),
        ("alphas_cumprod", []),
        ("alphas_cumprod", [0.5, 1.0]),
        ("alphas_cumprod", [0.0]),
        ("losses", {"training": 0.1}),
        ("surprise", 1),
    ],
)
def test_a_manifest_with_a_wrong_field_is_refused_by_its_name(
    manifest_file: Path, field: str, value: object
) -> None:
    edit(manifest_file, **{field: value})

    with pytest.raises(ValidationError, match=field):
        Manifest.read(manifest_file)


@pytest.mark.parametrize(
    "field",
    [
        "sha256",
        "system",
        "alphas_cumprod",
        "coverage",
        "trained_on",
        "condition",
        "predicts",
        "samplers",
    ],
)
def test_a_manifest_without_a_field_is_refused_by_its_name(manifest_file: Path, field: str) -> None:
    content = json.loads(manifest_file.read_text())
    del content[field]
    manifest_file.write_text(json.dumps(content))

    with pytest.raises(ValidationError, match=field):
        Manifest.read(manifest_file)


@pytest.fixture
def version_1_file(manifest_file: Path) -> Path:
    content = json.loads(manifest_file.read_text())
    for name in NEW:
        del content[name]
    manifest_file.write_text(json.dumps(content | VERSION_1))
    return manifest_file


def test_the_first_format_is_read_as_the_same_in_the_present_one(version_1_file: Path) -> None:
    manifest = Manifest.read(version_1_file)

    assert manifest.format_version == 2
    system = System(static_friction=0.6, coulomb_friction=0.5, control_limit=1.5)
    assert manifest.system == system
    assert manifest.coverage == Coverage.only(system)
    assert manifest.condition == Conditioning.on_states((0.1, 0.2), (0.8, 0.4))
    assert (manifest.name, manifest.horizon, manifest.predicts) == ("tiny", 64, "noise")
    assert "prior" in manifest.trained_on
    assert manifest.samplers == PAPER_MODEL_SAMPLERS


@pytest.mark.parametrize("name", ["dry-friction-fs0.6", "dry-friction-fs0.7", "dry-friction-fs0.8"])
def test_the_shipped_models_sample_as_they_always_did(name: str) -> None:
    manifest = Manifest.read(SHIPPED_MODELS / name / "1" / MANIFEST_FILE)

    default, ddim, paper = (
        ActionDiffusion(sampler=sampler).settled(manifest.samplers)
        for sampler in ("dpm_solver", "ddim", "paper")
    )

    assert (default.solver, manifest.times(default.settings)) == ("dpm_solver", [140, 95, 50, -1])
    assert default.settings.guidance_scale == 2.0
    assert ddim.solver == "ddim"
    assert manifest.times(ddim.settings) == [199, 177, 155, 133, 111, 88, 66, 44, 22, 0, -1]
    assert ddim.settings.guidance_scale == 1.5
    times = manifest.times(paper.settings)
    assert (paper.solver, len(times), times[0], times[-2]) == ("ddim", 51, 199, 0)
    assert paper.settings.guidance_scale == 2.0


def test_a_condition_goes_no_further_than_the_tasks_that_are_covered(
    publish: Callable[..., Path],
) -> None:
    condition = Conditioning(
        features=("displacement_over_reach", "static_forward_over_limit"),
        mean=(0.0, 0.0),
        std=(1.0, 1.0),
    )
    path = publish(coverage=ANY, condition=condition) / MANIFEST_FILE
    manifest = Manifest.read(path)

    def encoded(target: float) -> list[float]:
        values: list[float] = manifest.encode(
            Problem(np.zeros(2), np.array([target, 0.0]))
        ).tolist()
        return values

    near, far, opposite = encoded(0.1), encoded(100.0), encoded(-100.0)
    assert 0 < near[0] < 1.1
    assert far == pytest.approx([1.1, 0.7 / 0.9])
    assert opposite == pytest.approx([-1.1, 0.7 / 0.9])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("system", {"static_friction": 0.5, "coulomb_friction": 0.6}),
        ("system", {"static_friction": 0.7, "mass": 1.0}),
        ("state_std", [0.0, 1.0]),
        ("state_std", [1.0]),
        ("state_mean", [float("nan"), 0.0]),
        ("horizon", 0),
        ("control_scale", 0.0),
        ("control_scale", 0.9),
        ("coverage", {"ranges": RANGES}),
        ("surprise", 1),
    ],
)
def test_the_first_format_with_a_wrong_field_is_refused_by_its_name(
    version_1_file: Path, field: str, value: object
) -> None:
    edit(version_1_file, **{field: value})

    with pytest.raises(ValidationError, match=field):
        Manifest.read(version_1_file)


def test_what_is_not_json_is_refused(manifest_file: Path) -> None:
    manifest_file.write_text("{")

    with pytest.raises(ValidationError):
        Manifest.read(manifest_file)


def test_a_missing_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        Manifest.read(tmp_path / "nowhere")
