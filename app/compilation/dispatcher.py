"""A function as Numba's dispatcher, with what we want otherwise than Numba."""

# Numba fills in much at run time, where the type checker does not see it.
# mypy: disable-error-code="attr-defined, no-untyped-call"

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import types

from app.compilation.cache import KernelCache


def make_dispatcher(function: Callable[..., Any], package: Path, *, is_inlined: bool) -> Any:
    """Return what compiles `function` for each set of argument types, and keeps the result.

    Args:
        function: to be compiled, without the interpreter lock.
        package: the folder with all kernels that it may call.
        is_inlined: whether it becomes a part of each kernel that calls it.
    """
    dispatcher: Any = njit(nogil=True, forceinline=is_inlined)(function)
    # As Numba's own `enable_caching` does it with the cache that it comes with.
    dispatcher._cache = KernelCache(function, package)
    resolve = dispatcher.get_call_template

    def resolve_types(arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        """Resolve a kernel's call of this one; Numba would compile it for each constant anew."""
        return resolve(tuple(types.unliteral(argument) for argument in arguments), keywords)

    dispatcher.get_call_template = resolve_types
    return dispatcher
