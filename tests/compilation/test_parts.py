"""Kernels compiled by processes beside the one that needs them."""

from pathlib import Path

from app.compilation import KERNEL_PACKAGES, Kernel
from app.compilation.cache import folders
from app.compilation.parts import are_kept
from app.serving.kernels import ALL, prepare
from tests.compilation.source import kernels, run

COMPILE = """
import logging, sys, threading
from app.compilation.parts import Part, compile_missing
logging.basicConfig(format="%(message)s")
stop = threading.Event()
told = []
def tell(text):
    told.append(text)
    if sys.argv[2:] and list(__import__("pathlib").Path(sys.argv[2]).rglob("*push*.kernel")):
        stop.set()
part = Part("the probe", "app.planning.probe:" + sys.argv[1])
compile_missing([part], 1, tell, stop)
print(part.is_kept(), len(told), told[-1] if told else "")
"""


def test_the_parts_hold_every_kernel_of_planning_and_network() -> None:
    prepare(ALL)
    assert are_kept(ALL)
    kept = [
        file.name
        for package in KERNEL_PACKAGES
        for folder in folders(package)
        for file in folder.glob("*.kernel")
    ]
    for kernel in Kernel.all:
        if kernel.package in KERNEL_PACKAGES:
            name = f"{kernel.name}."
            assert any(file.startswith(name) for file in kept), name


def test_a_part_is_compiled_once_and_told_of(source: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    first = run(source, folder, "-c", COMPILE, "push_once")
    assert first.stdout.startswith("True ")
    assert "compiling kernels, once on this machine: the probe (" in first.stdout
    assert not first.stderr
    again = run(source, folder, "-c", COMPILE, "push_once")
    assert again.stdout == "True 0 \n"


def test_a_part_with_a_truncated_kernel_is_not_kept(source: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    run(source, folder, "-c", COMPILE, "push_once")
    kernel = next(file for file in kernels(folder) if "push" in file.name)
    kernel.write_bytes(kernel.read_bytes()[:-1])

    done = run(source, folder, "-c", COMPILE, "push_once")

    assert done.stdout.startswith("True ")
    assert "compiling" in done.stdout


def test_a_process_that_fails_is_told_of_and_ends_nothing(source: Path, tmp_path: Path) -> None:
    done = run(source, tmp_path / "cache", "-c", COMPILE, "fail")
    assert done.stdout.startswith("False ")
    assert "could not compile the probe: MemoryError: no room" in done.stderr


def test_a_stop_ends_the_processes_and_keeps_what_is_done(source: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    done = run(source, folder, "-c", COMPILE, "wait", str(folder))
    assert done.stdout.startswith("False ")
    assert any("push" in kernel.name for kernel in kernels(folder))
