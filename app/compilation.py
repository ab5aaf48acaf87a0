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
from functools import cached_property, lru_cache, update_wrapper
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar, cast

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
    import platformdirs
    from numba import config

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


class Kernel(Generic[R]):
    """A function that Numba compiles; Numba itself is loaded at the first call.

    So what only names methods and options, as clients do, needs neither Numba nor a cache folder.
    """

    def __init__(self, function: Callable[..., R]) -> None:
        self._function = function
        update_wrapper(self, function)

    def __call__(self, *args: Any) -> R:
        result: R = self._dispatcher(*args)
        return result

    @cached_property
    def _dispatcher(self) -> Any:
        from numba import config, njit

        directory = _cache_directory(_package(self._function))
        before = config.CACHE_DIR
        config.CACHE_DIR = directory or before
        try:
            return njit(nogil=True, cache=directory is not None)(self._function)
        finally:
            config.CACHE_DIR = before

    @property
    def _numba_type_(self) -> Any:
        """What Numba asks of a value that it meets in a kernel: this one is called from others."""
        return self._dispatcher._numba_type_


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` on its first call with each set of argument types.

    Floating-point results stay those of the source (no `fastmath`), and one call uses one core
    (no `parallel`): the service runs several plans at once instead. Where no folder can be written
    to, the kernel is compiled anew in each process.
    """
    return cast(Callable[P, R], Kernel(function))
