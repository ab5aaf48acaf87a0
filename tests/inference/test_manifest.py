import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from app.inference.conditioning import Conditioning
from app.inference.manifest import MANIFEST_FILE, Manifest
from app.planning.plant.plant_range import PlantRange
from app.planning.plant.system import System

PLANTS = asdict(PlantRange.only(System()))
CONDITION = Conditioning.on_states((0.1, 0.2), (0.8, 0.4)).model_dump()
VERSION_1 = {
    "format_version": 1,
    "system": {"static_friction": 0.6, "coulomb_friction": 0.5, "control_limit": 1.5},
    "state_mean": [0.1, 0.2],
    "state_std": [0.8, 0.4],
}
"""What the first format has in place of plants, condition and predicts."""


def edit(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.fixture
def manifest_file(publish: Callable[..., Path]) -> Path:
    return publish() / MANIFEST_FILE


def test_what_was_written_is_what_is_read(publish: Callable[..., Path]) -> None:
    plants = replace(PlantRange.only(System()), static_friction=(0.6, 0.1 + 0.7))
    condition = Conditioning(features=("target_position",), mean=(0.1,), std=(0.1 + 0.2,))
    directory = publish(
        "slippery",
        3,
        plants=plants,
        condition=condition,
        horizon=32,
        alphas_cumprod=(0.9, 0.1 + 0.2),
    )

    manifest = Manifest.read(directory / MANIFEST_FILE)

    assert (manifest.name, manifest.version, manifest.horizon) == ("slippery", 3, 32)
    assert manifest.format_version == 2
    assert manifest.plants == plants
    assert manifest.alphas_cumprod == (0.9, 0.1 + 0.2)
    assert manifest.condition == condition
    assert manifest.predicts == "noise"
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
        ("plants", {"static_friction": [0.5, 0.8]}),
        ("plants", PLANTS | {"mass": [1.0, 1.0]}),
        ("plants", PLANTS | {"static_friction": [0.8, 0.6]}),
        ("plants", PLANTS | {"static_friction": [0.1, 0.5]}),
        ("predicts", "velocity"),
        ("horizon", 0),
        ("control_scale", 0.0),
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
    "field", ["sha256", "plants", "condition", "control_scale", "alphas_cumprod"]
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
    for name in ("plants", "condition", "predicts"):
        del content[name]
    manifest_file.write_text(json.dumps(content | VERSION_1))
    return manifest_file


def test_the_first_format_is_read_as_the_same_in_the_present_one(version_1_file: Path) -> None:
    manifest = Manifest.read(version_1_file)

    assert manifest.format_version == 2
    assert manifest.plants == PlantRange.only(
        System(static_friction=0.6, coulomb_friction=0.5, control_limit=1.5)
    )
    assert manifest.condition == Conditioning.on_states((0.1, 0.2), (0.8, 0.4))
    assert (manifest.name, manifest.horizon, manifest.control_scale) == ("tiny", 64, 0.9)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("system", {"static_friction": 0.5, "coulomb_friction": 0.6}),
        ("system", {"static_friction": 0.7, "mass": 1.0}),
        ("state_std", [0.0, 1.0]),
        ("state_std", [1.0]),
        ("state_mean", [float("nan"), 0.0]),
        ("horizon", 0),
        ("plants", PLANTS),
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
