"""Where kernels are kept: what is found again by other processes, and what is not trusted."""

import os
import resource
import shutil
import subprocess
import tempfile
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from app.compilation import cache, compiled
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from tests.compilation.source import NOWHERE, kernels, run

PUSH = ("-m", "app.planning.probe")


def edit_plant(source: Path) -> None:
    """Make a mass break away faster."""
    plant = source / "app" / "planning" / "plant" / "friction.py"
    edited = plant.read_text().replace("velocity + time_step *", "velocity + 2 * time_step *")
    assert edited != plant.read_text()
    plant.write_text(edited)


def pushed() -> float:
    """Where the probe's mass ends, by the road that plans take."""
    return float(rollout(System(), np.zeros(2), np.full((1, 10), 0.9))[0, -1, 0])


def pushes(done: subprocess.CompletedProcess[str]) -> bool:
    """Say whether the probe's mass ended where it should, without a word on stderr."""
    return float.fromhex(done.stdout.split()[0]) == pushed() and not done.stderr


def test_kernels_are_kept_for_the_next_process(source: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    assert pushes(run(source, folder, *PUSH))
    kept = kernels(folder)
    assert pushes(run(source, folder, *PUSH))

    assert any("push" in kernel.name for kernel in kept)
    assert any("take_step" in kernel.name for kernel in kept)
    assert kernels(folder) == kept


def blocked(folder: Path) -> str:
    """Return a folder of temporary files in which a file stands in the place of our own folder."""
    (folder / f"breakaway-{os.getuid()}").touch()
    return str(folder)


def damage(file: Path, how: str) -> None:
    content = file.read_bytes()
    file.unlink()
    if how == "a folder":
        file.mkdir()
    else:
        file.write_bytes(
            {
                "empty": b"",
                "truncated": content[: len(content) // 2],
                "a flipped bit": content[:-100] + bytes([content[-100] ^ 1]) + content[-99:],
                "foreign": b"\x80\x05K\x01.",
            }[how]
        )


def test_a_damaged_kernel_is_compiled_anew_and_replaced(source: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    run(source, folder, *PUSH)
    whole = {kernel: kernel.stat().st_size for kernel in kernels(folder)}
    hows = ["empty", "truncated", "a flipped bit", "foreign"]
    assert len(whole) >= len(hows)
    for kernel, how in zip(whole, cycle(hows), strict=False):
        damage(kernel, how)

    assert pushes(run(source, folder, *PUSH))
    assert {kernel: kernel.stat().st_size for kernel in kernels(folder)} == whole
    assert all(cache.read(kernel) for kernel in whole)


def test_what_cannot_be_replaced_does_no_harm(source: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    run(source, folder, *PUSH)
    for kernel in kernels(folder):
        damage(kernel, "a folder")

    assert pushes(run(source, folder, *PUSH))


def test_where_the_users_folder_takes_nothing_a_temporary_one_does(
    source: Path, tmp_path: Path
) -> None:
    assert pushes(run(source, NOWHERE, *PUSH, TMPDIR=str(tmp_path)))
    kept = kernels(tmp_path)
    assert pushes(run(source, NOWHERE, *PUSH, TMPDIR=str(tmp_path)))

    assert kept
    assert kernels(tmp_path) == kept
    (folder,) = tmp_path.glob("breakaway-*")
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_temporary_folder_that_others_can_write_to_is_not_trusted(
    source: Path, tmp_path: Path
) -> None:
    run(source, NOWHERE, *PUSH, TMPDIR=str(tmp_path))
    (folder,) = tmp_path.glob("breakaway-*")
    before = kernels(tmp_path)
    folder.chmod(0o777)

    done = run(source, NOWHERE, *PUSH, TMPDIR=str(tmp_path))

    assert "KernelsNotKept" in done.stderr
    assert kernels(tmp_path) == before


def test_without_a_folder_the_kernels_give_the_same_results_and_one_warning(
    source: Path, tmp_path: Path
) -> None:
    done = run(source, NOWHERE, *PUSH, HOME="", TMPDIR=blocked(tmp_path))

    assert float.fromhex(done.stdout.strip()) == pushed()
    assert done.stderr.count("KernelsNotKept: kernels are compiled in every process") == 1


def test_on_a_full_disk_the_kernels_give_the_same_results_and_leave_nothing(
    source: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cache"

    def fill_the_disk() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    done = run(source, folder, *PUSH, before=fill_the_disk, TMPDIR=str(tmp_path))

    assert float.fromhex(done.stdout.strip()) == pushed()
    assert done.stderr.count("KernelsNotKept: kernels are compiled in every process") == 1
    assert not [file for file in folder.rglob("*") if file.is_file() and file.stat().st_size]


def test_kernels_that_come_with_the_installation_are_read_and_never_written(
    source: Path, tmp_path: Path
) -> None:
    run(source, tmp_path / "cache", *PUSH)
    shipped = tmp_path / "prefix" / "share" / "breakaway" / "kernels"
    shutil.copytree(tmp_path / "cache" / "breakaway", shipped)
    kept = kernels(shipped)
    with_prefix = f"import sys, runpy; sys.prefix = {str(tmp_path / 'prefix')!r}; "
    push = with_prefix + "runpy.run_module('app.planning.probe', run_name='__main__')"

    assert pushes(run(source, NOWHERE, "-c", push, TMPDIR=blocked(tmp_path)))
    assert kernels(shipped) == kept


def test_two_processes_that_start_at_once_share_the_work(source: Path, tmp_path: Path) -> None:
    count = (
        "from app.planning import probe; from app.planning.plant.system import System; "
        "print(probe.push(0.9, System().plant).hex(), "
        "sum(probe.push._dispatcher.stats.cache_misses.values()))"
    )
    with tempfile.TemporaryDirectory(dir=tmp_path) as folder:
        both = [run(source, folder, "-c", count, wait=False) for _ in range(2)]
        answers = [process.communicate(timeout=300)[0].split() for process in both]

    assert [float.fromhex(place) for place, _ in answers] == [pushed(), pushed()]
    assert sorted(misses for _, misses in answers) == ["0", "1"]


def test_a_function_that_closes_over_variables_is_no_kernel() -> None:
    step = 2.0

    def double(x: float) -> float:
        return step * x

    with pytest.raises(TypeError, match="double"):
        compiled(double)


def test_an_edited_plant_is_compiled_anew_in_the_kernels_that_call_it(
    source: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cache"
    before = run(source, folder, *PUSH).stdout
    edit_plant(source)

    after = run(source, folder, *PUSH).stdout

    assert float.fromhex(after.strip()) > float.fromhex(before.strip())


def test_an_edit_under_inference_leaves_the_kernels_of_planning_in_their_cache(
    source: Path, tmp_path: Path
) -> None:
    """A package's cache folder is made when the first of its kernels is called."""
    folder = tmp_path / "cache"

    def folders_after(call: str) -> set[Path]:
        run(source, folder, "-c", call)
        return {path for path in folder.glob("*/*") if path.is_dir()}

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
    folder = tmp_path / "cache"
    folder.mkdir()

    loaded = run(source, folder, "-c", "import app.client, sys; print(*sys.modules)").stdout.split()

    assert "app.wire.requests" in loaded
    assert not {"numba", "llvmlite", "torch", "fastapi", "pandas"} & set(loaded)
    assert not list(folder.iterdir())
