"""How the kernels are compiled: Numba, without the interpreter lock, cached where the disk allows.

Nothing here knows what a kernel computes.
"""

# Numba fills its settings at run time, where the type checker does not see them.
# mypy: disable-error-code="attr-defined"

import hashlib
import inspect
import tempfile
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import ParamSpec, TypeVar

import platformdirs
from numba import config, njit

P = ParamSpec("P")
R = TypeVar("R")


APP = Path(__file__).parent
KERNEL_PACKAGES = (APP / "planning", APP / "inference")
"""Kernels call kernels of their own package only."""


@lru_cache
def _cache_directory(package: Path) -> str | None:
    """Return a folder that changes whenever a source file of `package` does.

    Numba checks only the file that a kernel stands in, not the kernels that it calls in other
    files, so an edited plant would otherwise live on inside a cached CEM. None where the folder
    cannot be written to: Numba's own fallback, beside the sources, has just that flaw.
    """
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(source.read_bytes())
    base = config.CACHE_DIR or platformdirs.user_cache_dir("breakaway")
    directory = Path(base) / digest.hexdigest()[:16]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            return str(directory)
    except OSError as error:
        warnings.warn(
            f"kernels are compiled in every process: {error}", RuntimeWarning, stacklevel=1
        )
        return None


def _package(function: Callable[P, R]) -> Path:
    """Return the package that `function` stands in; the whole app for a kernel outside of it."""
    file = Path(inspect.getfile(function))
    return next((package for package in KERNEL_PACKAGES if file.is_relative_to(package)), APP)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` on its first call with each set of argument types.

    Floating-point results stay those of the source (no `fastmath`), and one call uses one core
    (no `parallel`): the service runs several plans at once instead. Where no folder can be written
    to, the kernel is compiled anew in each process.
    """
    directory = _cache_directory(_package(function))
    before = config.CACHE_DIR
    config.CACHE_DIR = directory or before
    try:
        return njit(nogil=True, cache=directory is not None)(function)
    finally:
        config.CACHE_DIR = before
