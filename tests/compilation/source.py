"""A copy of the package to tamper with, and processes that run it with caches of their own."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Kernels in this file call a kernel in another one, as the CEM calls the plant.
PROBE = """
import time
from app.compilation import compiled
from app.planning.plant.rollout import step
from app.planning.plant.system import System

@compiled
def push(control, plant):
    position, velocity = 0.0, 0.0
    for _ in range(10):
        position, velocity = step(position, velocity, control, plant)
    return position

def push_once():
    push(0.9, System().plant)

def fail():
    raise MemoryError("no room")

def wait():
    push_once()
    time.sleep(600)

if __name__ == "__main__":
    print(push(0.9, System().plant).hex())
"""
NOWHERE = "/dev/null/nowhere"


def run(
    source: Path,
    cache: str | Path,
    *arguments: str,
    wait: bool = True,
    before: Callable[[], None] | None = None,
    **environment: str,
) -> Any:
    """Run Python on a copy of the package; return what it did, or with `wait=False` the process.

    Args:
        source: the copy.
        cache: the user's cache folder.
        arguments: of the interpreter.
        wait: for its end.
        before: called in the new process.
        environment: more variables.
    """
    variables = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(source),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HOME": str(cache),
        "XDG_CACHE_HOME": str(cache),
        "TMPDIR": str(source),
        **environment,
    }
    process = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=source,
        env=variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=before,  # noqa: PLW1509 -- it only sets a limit
    )
    if not wait:
        return process
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    return subprocess.CompletedProcess(process.args, 0, output, errors)


def kernels(folder: Path) -> dict[Path, int]:
    """Return the kept kernels in a folder, with the times at which they were written."""
    return {file: file.stat().st_mtime_ns for file in folder.rglob("*.kernel")}
