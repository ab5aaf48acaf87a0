import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from app.inference.manifest import MANIFEST_FILE, Manifest
from app.planning.plant.system import System


def edit(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.fixture
def manifest_file(publish: Callable[..., Path]) -> Path:
    return publish() / MANIFEST_FILE


def test_what_was_written_is_what_is_read(publish: Callable[..., Path]) -> None:
    plant = System(static_friction=0.5, coulomb_friction=0.4, control_limit=1.5)
    directory = publish("slippery", 3, system=plant, horizon=32, alphas_cumprod=(0.9, 0.1 + 0.2))

    manifest = Manifest.read(directory / MANIFEST_FILE)

    assert (manifest.name, manifest.version, manifest.horizon) == ("slippery", 3, 32)
    assert manifest.system == plant
    assert manifest.alphas_cumprod == (0.9, 0.1 + 0.2)
    assert (manifest.state_mean, manifest.state_std) == ((0.1, 0.2), (0.8, 0.4))
    assert (manifest.losses.training, manifest.losses.validation) == (0.1, 0.2)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("format_version", 2),
        ("name", "../escape"),
        ("name", "Upper"),
        ("name", ""),
        ("version", 0),
        ("sha256", "abc"),
        ("system", {"static_friction": 0.5, "coulomb_friction": 0.6}),
        ("system", {"static_friction": 0.7, "mass": 1.0}),
        ("horizon", 0),
        ("control_scale", 0.0),
        ("state_std", [0.0, 1.0]),
        ("state_std", [1.0]),
        ("state_mean", [float("nan"), 0.0]),
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


@pytest.mark.parametrize("field", ["sha256", "system", "control_scale", "alphas_cumprod"])
def test_a_manifest_without_a_field_is_refused_by_its_name(manifest_file: Path, field: str) -> None:
    content = json.loads(manifest_file.read_text())
    del content[field]
    manifest_file.write_text(json.dumps(content))

    with pytest.raises(ValidationError, match=field):
        Manifest.read(manifest_file)


def test_what_is_not_json_is_refused(manifest_file: Path) -> None:
    manifest_file.write_text("{")

    with pytest.raises(ValidationError):
        Manifest.read(manifest_file)


def test_a_missing_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        Manifest.read(tmp_path / "nowhere")
