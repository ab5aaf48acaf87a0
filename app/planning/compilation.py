"""How the kernels are compiled: Numba, without the interpreter lock, cached where the disk allows.

Nothing here knows what a kernel computes.
"""

# Numba fills its settings at run time, where the type checker does not see them.
# mypy: disable-error-code="attr-defined"

import hashlib
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import platformdirs
from numba import config, njit

P = ParamSpec("P")
R = TypeVar("R")


def _cache_directory() -> str | None:
    """Return a folder that changes whenever a source file of this package does.

    Numba checks only the file that a kernel stands in, not the kernels that it calls in other
    files, so an edited plant would otherwise live on inside a cached CEM. None where the folder
    cannot be written to: Numba's own fallback, beside the sources, has just that flaw.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
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


_CACHE_DIRECTORY = _cache_directory()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` on its first call with each set of argument types.

    Floating-point results stay those of the source (no `fastmath`), and one call uses one core
    (no `parallel`): the service runs several plans at once instead. Where no folder can be written
    to, the kernel is compiled anew in each process.
    """
    before = config.CACHE_DIR
    config.CACHE_DIR = _CACHE_DIRECTORY or before
    try:
        return njit(nogil=True, cache=_CACHE_DIRECTORY is not None)(function)
    finally:
        config.CACHE_DIR = before
