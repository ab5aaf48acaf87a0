"""How the kernels are compiled: Numba, without the interpreter lock, cached where the disk allows.

Nothing here knows what a kernel computes.
"""

# Numba fills its settings at run time, where the type checker does not see them.
# mypy: disable-error-code="attr-defined"

import hashlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import platformdirs
from numba import config, njit

P = ParamSpec("P")
R = TypeVar("R")


def _cache_directory() -> str:
    """Return a folder that changes whenever a source file of this package does.

    Numba checks only the file that a kernel stands in, not the kernels that it calls in other
    files, so an edited plant would otherwise live on inside a cached CEM.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    base = config.CACHE_DIR or platformdirs.user_cache_dir("breakaway")
    return str(Path(base) / digest.hexdigest()[:16])


_CACHE_DIRECTORY = _cache_directory()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` on its first call with each set of argument types.

    Floating-point results stay those of the source (no `fastmath`), and one call uses one core
    (no `parallel`): the service runs several plans at once instead. Where no folder can be written
    to, the kernel is compiled anew in each process.
    """
    before = config.CACHE_DIR
    config.CACHE_DIR = _CACHE_DIRECTORY
    try:
        return njit(nogil=True, cache=True)(function)
    except (RuntimeError, OSError):
        # Reported from this line whichever kernel it is, so that it is reported once.
        warnings.warn(
            f"{_CACHE_DIRECTORY} cannot be written to: kernels are compiled in every process",
            RuntimeWarning,
            stacklevel=1,
        )
        return njit(nogil=True)(function)
    finally:
        config.CACHE_DIR = before
