"""`python -m tests.container`: builds the image without an engine, runs it, and gives a verdict.

As root, in a clone, with buildah and, unless a base image is named, debootstrap.
"""

import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import dropwhile
from os import getloadavg
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import Any

import click
import httpx
from llvmlite.binding import get_host_cpu_features

from app.compilation.target import LEVELS, level
from app.settings import SHIPPED_MODELS
from tests.container.buildah import Buildah
from tests.container.chroot import Image, Served, serving
from tests.container.on_ray import serving_on_ray

ANYBODY = "54321:0"
"""As OpenShift runs it: a user that the image does not know, of group 0."""
MODEL = "dry-friction-fs0.7"
MAX_BYTES = 1.5e9
MAX_START_SECONDS = 10
"""Of a core: a machine that is busy with other things takes longer by the clock."""
STARTS = 3
COMPILERS = ("cc", "gcc", "g++", "clang", "ld", "as", "make")
PLAN = {"initial_state": [0, 0], "target_state": [0.2, 0], "num_candidates": 16, "seed": 7}
LONG = {**PLAN, "method": {"name": "cem", "iterations": 1000}, "num_candidates": 4096}
KEPT = """
import sys
from app.compilation.parts import are_kept
from app.serving.kernels import ALL
sys.exit(not are_kept(ALL))
"""


@click.command()
@click.option("--folder", type=Path, required=True, help="Takes images, some gigabytes.")
@click.option("--base-image", help="By default one made of Debian's packages.")
@click.option("--wheel-index", required=True, help="A page or a folder that has the CPU torch.")
def container(folder: Path, base_image: str | None, wheel_index: str) -> None:
    """Build the image, run it, build and run the one for Ray, and tell what holds."""
    buildah = Buildah(folder)
    base = base_image or buildah.debian()
    failed = False
    for extra, check in (("", _alone), ("ray", _on_ray)):
        buildah.build(base, wheel_index, extra)
        layers = buildah.layers()
        for layer in layers:
            print(f"{layer.size / 1e6:8.1f} MB  {' '.join(layer.command.split())[:100]}")
        total = sum(layer.size for layer in layers)
        with buildah.mounted() as root:
            for what, holds, detail in check(Image(root, buildah.config()), total):
                print(f"{'holds ' if holds else 'FAILS '} {what}{f': {detail}' if detail else ''}")
                failed |= not holds
    sys.exit(failed)


Check = tuple[str, bool, str]


def _alone(image: Image, size: int) -> Iterator[Check]:
    yield "smaller than 1.5 GB", size < MAX_BYTES, f"{size / 1e6:.0f} MB"
    yield from _contents(image)
    yield from _start(image)
    yield from _plans(image)
    yield from _threads(image)
    yield from _mounted(image)


def _contents(image: Image) -> Iterator[Check]:
    found = [str(path) for name in COMPILERS for path in image.root.glob(f"usr/bin/{name}")]
    yield "no compiler", not found, ", ".join(found)
    yield "not root, by number", image.config["User"].split(":")[0] not in ("", "0"), ""
    labels = image.config["Labels"]
    wanted = ("title", "description", "version", "revision", "base.name")
    missing = [name for name in wanted if not labels.get(f"org.opencontainers.image.{name}")]
    yield "labels", not missing, ", ".join(missing)
    for name in LEVELS:
        status = image.run(
            *("python", "-c", KEPT),
            user=ANYBODY,
            NUMBA_CPU_NAME=name,
            NUMBA_CPU_FEATURES="",
        )
        yield f"kernels for {name}", status == 0, ""


def _start(image: Image) -> Iterator[Check]:
    highest = level(get_host_cpu_features())
    for name in dropwhile(lambda name: name != highest, LEVELS):
        core, clock = map(min, zip(*(_timed(image, name) for _ in range(STARTS)), strict=True))
        detail = f"{core:.1f} s of a core, {clock:.1f} s by the clock, load {getloadavg()[0]:.1f}"
        yield f"the first start on {name}", core < MAX_START_SECONDS, detail
    seconds = {}
    for access in ("rw", "ro"):
        with serving(image, ANYBODY, access=access) as served:
            seconds[access] = served.core_seconds()
            compiled = [path.name for path in served.written() if path.suffix == ".kernel"]
            status = image.run(
                *image.config["Healthcheck"]["Test"][1:],
                user=ANYBODY,
                BREAKAWAY_PORT=served.url.rpartition(":")[2],
            )
    # One that is not there: the check has to be able to fail.
    away = image.run(*image.config["Healthcheck"]["Test"][1:], user=ANYBODY, BREAKAWAY_PORT="1")
    detail = f"{seconds['ro']:.1f} and {seconds['rw']:.1f} s of a core"
    yield "read-only as fast as writable", seconds["ro"] < 1.2 * seconds["rw"], detail
    yield "no kernel is compiled", not compiled, ", ".join(compiled)
    yield "health check", (status, away) == (0, 1), ""


def _timed(image: Image, name: str) -> tuple[float, float]:
    """Return what a start takes of a core, and by the clock, in seconds."""
    with serving(image, ANYBODY, NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES="") as served:
        return served.core_seconds(), served.start_seconds


def _plans(image: Image) -> Iterator[Check]:
    with serving(image, ANYBODY) as served, ThreadPoolExecutor() as threads:
        answer = _ask(served, PLAN)
        yield "plans", answer.is_success, f"ends {answer.json()['terminal_error']:.2g} m away"
        last = threads.submit(_ask, served, LONG)
        sleep(0.5)
        served.tell_to_end()
        told = perf_counter()
        finished = last.result()
        status = served.process.wait(60)
        detail = f"{finished.status_code}, ended with {status} after {perf_counter() - told:.1f} s"
        yield "SIGTERM finishes a plan that is under way", finished.is_success, detail
        yield "ends by itself", status == 0, ""


def _threads(image: Image) -> Iterator[Check]:
    with serving(image, ANYBODY, cpus="100000 100000") as served:
        threads = httpx.get(f"{served.url}/info", trust_env=False).json()["network_threads"]
    yield "one thread for a quota of one core", threads == 1, ""


def _mounted(image: Image) -> Iterator[Check]:
    with TemporaryDirectory() as models:
        Path(models).chmod(0o755)
        shutil.copytree(SHIPPED_MODELS / MODEL, Path(models) / MODEL)
        with serving(image, ANYBODY, models=models) as served:
            found = httpx.get(f"{served.url}/models", trust_env=False).json()
    names = [model["name"] for model in found]
    yield "models mounted over /models", names == [MODEL], ", ".join(names)


def _on_ray(image: Image, size: int) -> Iterator[Check]:
    with serving_on_ray(image, ANYBODY) as served:
        answer = _ask(served, PLAN)
    yield "plans on Ray", answer.is_success, f"{size / 1e6:.0f} MB, {served.start_seconds:.0f} s"


def _ask(served: Served, request: dict[str, Any]) -> httpx.Response:
    return httpx.post(f"{served.url}/plan", json=request, timeout=60, trust_env=False)


if __name__ == "__main__":
    container()
