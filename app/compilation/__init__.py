"""How the kernels are compiled: Numba, without the interpreter lock, kept for later processes.

Nothing here knows what a kernel computes. `cache.py` says where kernels are kept.
"""

import inspect
from collections.abc import Callable
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import Any, ClassVar, Generic, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")


APP = Path(__file__).parents[1]
KERNEL_PACKAGES = (APP / "planning", APP / "inference")
"""Kernels call kernels of their own package only."""


class Kernel(Generic[R]):
    """A function that Numba compiles; Numba itself is loaded at the first call.

    So what only names methods and options, as clients do, needs neither Numba nor a cache folder.
    """

    all: ClassVar[list["Kernel[Any]"]] = []
    """Those that were imported."""

    def __init__(self, function: Callable[..., R], *, is_inlined: bool = False) -> None:
        if function.__closure__:
            raise TypeError(f"{function.__qualname__} depends on more than its source")
        self._function = function
        self._is_inlined = is_inlined
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.package = package_of(function)
        self.all.append(self)
        update_wrapper(self, function)

    def __call__(self, *args: Any) -> R:
        result: R = self._dispatcher(*args)
        return result

    def compile_for(self, signature: Any) -> None:
        """Compile for these types of arguments, unless that was done, and keep the result."""
        self._dispatcher.compile(signature)

    @cached_property
    def _dispatcher(self) -> Any:
        from app.compilation.dispatcher import make_dispatcher

        return make_dispatcher(self._function, self.package, is_inlined=self._is_inlined)

    @property
    def _numba_type_(self) -> Any:
        """What Numba asks of a value that it meets in a kernel: this one is called from others."""
        return self._dispatcher._numba_type_


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` on its first call with each set of argument types.

    Floating-point results stay those of the source (no `fastmath`), and one call uses one core
    (no `parallel`): the service runs several plans at once instead.

    Raises:
        TypeError: the function closes over variables, which a kept kernel would not notice change.
    """
    return cast(Callable[P, R], Kernel(function))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` as `compiled` does, and into each kernel that calls it.

    For the small steps of an inner loop that hand a state on: a call would send each of its numbers
    through memory.

    Raises:
        TypeError: as `compiled` does.
    """
    return cast(Callable[P, R], Kernel(function, is_inlined=True))


def package_of(function: Callable[..., Any]) -> Path:
    """Return the package that `function` stands in; the whole app for a kernel outside of it."""
    file = Path(inspect.getfile(function))
    return next((package for package in KERNEL_PACKAGES if file.is_relative_to(package)), APP)
