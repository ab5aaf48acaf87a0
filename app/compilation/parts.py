"""Compiling kernels in processes of their own: on all cores, and ended at any moment.

A compiler holds the interpreter's lock and heeds no signal; what a process beside this one compiles
is kept, and found by whoever needs it.
"""

import json
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from pkgutil import resolve_name
from time import perf_counter
from typing import NamedTuple

from app.compilation import Kernel, package_of

POLL_SECONDS = 0.1

log = logging.getLogger(__name__)


class Part(NamedTuple):
    """Some kernels, by a function that calls all of them."""

    title: str
    """For people."""
    function: str
    """`module:function`, of the package with the kernels."""

    @property
    def package(self) -> Path:
        """Where its kernels stand; this imports them."""
        return package_of(resolve_name(self.function))

    def is_kept(self) -> bool:
        """Say whether all its kernels were kept, and are still there, whole by their sizes."""
        from app.compilation.cache import folders, read

        places = folders(self.package)
        return any(
            note is not None
            and all(
                any(_size(place / name) == size for place in places)
                for name, size in json.loads(note).items()
            )
            for note in (read(place / self._note) for place in places)
        )

    def compile(self) -> None:
        """Call the function here, and note which kernels it took.

        Raises:
            KernelsNotKept: no folder takes one of them.
        """
        self._keep(resolve_name(self.function))

    def compile_again(self, kept: Path) -> None:
        """Compile here what another process did, which may have done so for another processor.

        Nothing is called: this processor may not be able to.

        Args:
            kept: the folder in which the other process noted what it compiled.

        Raises:
            KernelsNotKept: no folder takes one of the kernels.
            FileNotFoundError: the other process did not note the part, or a kernel is damaged.
        """
        from app.compilation.cache import signature

        def compile_all() -> None:
            resolve_name(self.function)  # imports them
            kernels = {kernel.name: kernel for kernel in Kernel.all}
            for file in json.loads(_whole(kept / self._note)):
                kernel = kernels[file.rsplit(".", 2)[0]]
                kernel.compile_for(signature(_whole(kept / file)))

        self._keep(compile_all)

    def _keep(self, compile_kernels: Callable[[], None]) -> None:
        import warnings

        from app.compilation.cache import KernelsNotKept, used, writable_folders, write

        with warnings.catch_warnings(action="error", category=KernelsNotKept):
            compile_kernels()
        folder = next(writable_folders(self.package))
        write(folder / self._note, json.dumps(used).encode())

    @property
    def _note(self) -> str:
        return f"{self.function.replace(':', '.')}.part"


def are_kept(parts: Iterable[Part]) -> bool:
    """Say whether nothing of them has to be compiled."""
    return all(part.is_kept() for part in parts)


def compile_missing(
    parts: Iterable[Part],
    processes: int,
    tell: Callable[[str], None],
    stop: threading.Event,
) -> None:
    """Compile the parts that are not kept, in processes beside this one; blocks.

    It is a help and no more: what a process could not do is logged, and is compiled where it is
    first called.

    Args:
        parts: what will be needed.
        processes: how many at once.
        tell: takes a line that says what is going on, several times a second.
        stop: ends the processes when it is set; then this returns.
    """
    waiting = [part for part in parts if not part.is_kept()]
    if not waiting:
        return
    titles = ", ".join(part.title for part in waiting)
    log.info("compiling kernels, once on this machine: %s", titles)
    started = perf_counter()
    running: dict[Part, subprocess.Popen[bytes]] = {}
    try:
        while (waiting or running) and not stop.is_set():
            while waiting and len(running) < processes:
                part = waiting.pop(0)
                try:
                    running[part] = _start(part)
                except OSError as error:
                    log.warning("no process to compile %s in: %s", part.title, error)
            tell(_progress(running))
            stop.wait(POLL_SECONDS)
            for part in [part for part in running if running[part].poll() is not None]:
                _conclude(part, running.pop(part))
        if stop.is_set():
            return
    finally:
        for process in running.values():
            process.kill()
            process.communicate()
    log.info("kernels compiled in %.1f s", perf_counter() - started)


def compile_for_all_levels(parts: Iterable[Part]) -> None:
    """Compile what is kept for this processor for those of every other level as well; blocks.

    Raises:
        CalledProcessError: a part could not be compiled, for this processor or for another one.
    """
    from app.compilation.cache import writable_folders
    from app.compilation.target import LEVELS

    for level in LEVELS:
        variables = {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
        for part in parts:
            kept = next(writable_folders(part.package))
            subprocess.run(
                [sys.executable, "-m", __package__, *part, str(kept)],
                env=os.environ | variables,
                check=True,
            )


def _start(part: Part) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", __package__, *part],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # a terminal's Ctrl-C is for this process, which ends that one
    )


def _conclude(part: Part, process: "subprocess.Popen[bytes]") -> None:
    _, errors = process.communicate()
    if process.returncode:
        reason = errors.decode(errors="replace").strip().rpartition("\n")[2]
        log.warning("a process could not compile %s: %s", part.title, reason or -process.returncode)


def _progress(parts: Iterable[Part]) -> str:
    from app.compilation.cache import folders

    packages = {part.package for part in parts}
    kept = {
        file.name
        for package in packages
        for folder in folders(package)
        for file in folder.glob("*.kernel")
    }
    total = sum(kernel.package in packages for kernel in Kernel.all)
    titles = ", ".join(part.title for part in parts)
    return f"compiling kernels, once on this machine: {titles} ({len(kept)} of {total})"


def _whole(file: Path) -> bytes:
    from app.compilation.cache import read

    content = read(file)
    if content is None:
        raise FileNotFoundError(file)
    return content


def _size(file: Path) -> int | None:
    try:
        return file.stat().st_size
    except OSError:
        return None
