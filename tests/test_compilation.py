import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import app.planning
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System

# Kernels in this file call a kernel in another one, as the CEM calls the plant.
PROBE = """
from app.compilation import compiled
from app.planning.plant.rollout import step
from app.planning.plant.system import System

@compiled
def push(control, plant):
    position, velocity = 0.0, 0.0
    for _ in range(10):
        position, velocity = step(position, velocity, control, plant)
    return position

if __name__ == "__main__":
    print(push(0.9, System().plant).hex())
"""
NOWHERE = "/dev/null/nowhere"


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Copy the package to where its caches and sources can be tampered with."""
    package = Path(app.planning.__file__).parents[1]
    copy = tmp_path / "source"
    shutil.copytree(package, copy / "app", ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "app" / "planning" / "probe.py").write_text(PROBE)
    return copy


def run(source: Path, cache: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(source),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HOME": cache,
        "XDG_CACHE_HOME": cache,
        "LOCALAPPDATA": cache,
    }
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=source,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )


def block_caches_in(source: Path) -> None:
    """Let a file stand where a cache folder would be made; this stops even root."""
    for folder in ("planning", "planning/plant"):
        (source / "app" / folder / "__pycache__").touch()


def edit_plant(source: Path) -> None:
    """Make a mass break away faster."""
    plant = source / "app" / "planning" / "plant" / "friction.py"
    edited = plant.read_text().replace("velocity + time_step *", "velocity + 2 * time_step *")
    assert edited != plant.read_text()
    plant.write_text(edited)


def pushed() -> float:
    """Where the probe's mass ends, by the road that plans take."""
    return float(rollout(System(), np.zeros(2), np.full((1, 10), 0.9))[0, -1, 0])


def test_an_edited_plant_is_compiled_anew_where_the_cache_folder_cannot_be_written(
    source: Path,
) -> None:
    before = run(source, NOWHERE, "-m", "app.planning.probe").stdout
    edit_plant(source)
    after = run(source, NOWHERE, "-m", "app.planning.probe").stdout

    assert float.fromhex(after.strip()) > float.fromhex(before.strip())


def test_without_any_cache_folder_the_kernels_give_the_same_results_and_one_warning(
    source: Path,
) -> None:
    block_caches_in(source)

    result = run(source, NOWHERE, "-m", "app.planning.probe")

    assert float.fromhex(result.stdout.strip()) == pushed()
    assert result.stderr.count("RuntimeWarning") == 1
    assert "compiled in every process" in result.stderr


def test_kernels_are_kept_for_the_next_process(source: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"

    first = run(source, str(cache), "-m", "app.planning.probe")
    kept = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbc")}
    again = run(source, str(cache), "-m", "app.planning.probe")

    assert float.fromhex(first.stdout.strip()) == pushed()
    assert again.stdout == first.stdout
    assert not first.stderr
    assert kept
    assert kept == {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbc")}


def test_an_edited_plant_is_compiled_anew_in_the_kernels_that_call_it(
    source: Path, tmp_path: Path
) -> None:
    cache = str(tmp_path / "cache")
    before = run(source, cache, "-m", "app.planning.probe").stdout
    edit_plant(source)

    after = run(source, cache, "-m", "app.planning.probe").stdout

    assert float.fromhex(after.strip()) > float.fromhex(before.strip())


def test_an_edit_under_inference_leaves_the_kernels_of_planning_in_their_cache(
    source: Path, tmp_path: Path
) -> None:
    """A package's cache folder is made when the first of its kernels is called."""
    cache = tmp_path / "cache"

    def folders_after(call: str) -> set[Path]:
        run(source, str(cache), "-c", call)
        return {path for path in cache.glob("*/*") if path.is_dir()}

    plan = "from app.planning.plant.rollout import *; step(0.0, 0.0, 0.0, System().plant)"
    infer = "from app.inference.kernel.convolution import *; make_scratch(8, 16)"
    planning = folders_after(plan)
    both = folders_after(infer)
    with (source / "app" / "inference" / "kernel" / "simd.py").open("a") as file:
        file.write("# edited\n")

    assert len(planning) == 1
    assert len(both - planning) == 1
    assert folders_after(plan) == both
    assert len(folders_after(infer) - both) == 1


def test_a_client_needs_neither_numba_nor_torch_nor_a_cache_folder(
    source: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()

    loaded = run(
        source, str(cache), "-c", "import app.client, sys; print(*sys.modules)"
    ).stdout.split()

    assert "app.wire.requests" in loaded
    assert not {"numba", "llvmlite", "torch", "fastapi", "pandas"} & set(loaded)
    assert not list(cache.iterdir())
