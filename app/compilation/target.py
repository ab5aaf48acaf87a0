"""The processors that kernels are compiled for: levels of x86-64 that many of them share.

A kernel for exactly this processor would be of no use on the next one. Kernels for a level come
with an image, and all replicas of a service run the same machine code. The psABI of x86-64 defines
the levels.
"""

# Numba fills in its configuration at run time.
# mypy: disable-error-code="attr-defined, no-untyped-call"

from collections.abc import Mapping

from llvmlite.binding import get_host_cpu_features
from numba import config

_V3 = {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"}
LEVELS = {
    "x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "x86-64-v3": _V3,
}
"""LLVM's names of the levels and of what a processor must have, the highest first."""


def level(features: Mapping[str, bool]) -> str | None:
    """Return the highest level that a processor with these features has; None for any other."""
    has = {name for name, is_there in features.items() if is_there}
    return next((name for name, needed in LEVELS.items() if needed <= has), None)


def choose() -> None:
    """Have Numba compile for the level of this processor, before it compiles anything.

    On a processor without a level it goes by that very processor, and where its own variables
    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES are set, by those.
    """
    if config.CPU_NAME is None and (name := level(get_host_cpu_features())):
        config.CPU_NAME, config.CPU_FEATURES = name, ""
