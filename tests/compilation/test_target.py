"""The levels of x86-64 that kernels are compiled for, and compiling for another one."""

from pathlib import Path
from typing import Any

import pytest

from app.compilation.target import LEVELS, level
from tests.compilation.source import kernels, run

HASWELL = dict.fromkeys(LEVELS["x86-64-v3"], True)
SKYLAKE_SERVER = dict.fromkeys(LEVELS["x86-64-v4"], True)
COMPILE = """
import sys
from app.compilation import target
from app.compilation.parts import Part, compile_for_all_levels
part = Part("the probe", "app.planning.probe:push_once")
part.compile()
target.LEVELS = {name: target.LEVELS[name] for name in sys.argv[1:]}
compile_for_all_levels([part])
"""
PUSH = (
    "from numba.core.registry import cpu_target; from app.planning import probe; "
    "from app.planning.plant.system import System; "
    "print(probe.push(0.9, System().plant).hex(), "
    "sum(probe.push._dispatcher.stats.cache_hits.values()), "
    "cpu_target.target_context.codegen().magic_tuple()[1])"
)


def run_for(name: str, source: Path, folder: Path, code: str) -> Any:
    """Run Python as it were on a processor of this level."""
    return run(source, folder, "-c", code, NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES="")


@pytest.mark.parametrize(
    ("features", "name"),
    [
        (SKYLAKE_SERVER, "x86-64-v4"),
        (HASWELL, "x86-64-v3"),
        (SKYLAKE_SERVER | {"avx512vl": False}, "x86-64-v3"),
        (SKYLAKE_SERVER | {"fma": False}, None),  # as some hypervisors mask it
        ({"neon": True, "sve": True}, None),
    ],
)
def test_a_processor_is_of_the_highest_level_whose_features_it_all_has(
    features: dict[str, bool], name: str | None
) -> None:
    assert level(features) == name


def test_what_is_compiled_for_a_level_is_used_on_its_processors_only(
    source: Path, tmp_path: Path
) -> None:
    """`x86-64-v2` stands for a processor that is not this one, and that this one can play."""
    folder = tmp_path / "cache"
    compile_for = COMPILE.replace("target.LEVELS[name]", "set()")
    run(source, folder, "-c", compile_for, "x86-64-v2")
    kept = kernels(folder)

    here = run(source, folder, "-c", PUSH).stdout.split()
    there = run_for("x86-64-v2", source, folder, PUSH).stdout.split()

    assert kernels(folder) == kept  # nothing was missing
    assert here[1] == there[1] == "1"
    assert there[2] == "x86-64-v2" != here[2]
    assert here[0] == there[0]


def test_kernels_for_a_processor_that_is_not_here_are_compiled_and_not_called(
    source: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cache"
    run(source, folder, "-c", COMPILE, "x86-64-v4")
    is_kept = (
        "from app.compilation.parts import Part; "
        "print(Part('', 'app.planning.probe:push_once').is_kept())"
    )
    assert run_for("x86-64-v4", source, folder, is_kept).stdout == "True\n"
    assert run_for("x86-64-v2", source, folder, is_kept).stdout == "False\n"
