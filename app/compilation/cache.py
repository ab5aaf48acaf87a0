"""Where compiled kernels are kept: one file a kernel and signature, checked when it is read.

Numba's own cache ends the process at a file that is damaged, does not look where it may not write,
and checks only the file that a kernel stands in, not the kernels that it calls in other files.
"""

# Numba fills in much at run time, where the type checker does not see it.
# mypy: disable-error-code="attr-defined, no-untyped-call"

import hashlib
import os
import pickle
import platform
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import filelock
import platformdirs
from numba import config
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from app.compilation import target

target.choose()

DIGEST_BYTES = 16
SHIPPED = Path(sys.prefix) / "share" / "breakaway" / "kernels"
"""Kernels that came with the installation, such as an image's; they are only read."""
PATIENCE_SECONDS = 120
"""How long to wait for another process that compiles the same kernel, before doing it as well."""


used: dict[str, int] = {}
"""The kept kernels that this process read or wrote: their sizes in bytes, by the file's name."""


class KernelsNotKept(RuntimeWarning):
    """No folder takes the compiled kernels: each process compiles them anew."""


class KernelCache(_Cache):
    """Keeps the compiled forms of one function, as Numba's dispatcher asks it to.

    While a process compiles a kernel, others that need it wait for the file.

    Args:
        function: whose compiled forms these are.
        package: the folder with all kernels that it may call.
    """

    def __init__(self, function: Callable[..., Any], package: Path) -> None:
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._package = package
        self._locks: dict[str, filelock.BaseFileLock] = {}

    @property
    def cache_path(self) -> str:
        """The first folder that a kernel is looked for in."""
        return str(folders(self._package)[0])

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the function compiled for `sig`, or None if it has to be compiled."""
        target_context.refresh()
        name = self._file_name(sig)
        found = self._read(name, target_context)
        if found is None:
            self._lock(name)
            # It may have been compiled elsewhere meanwhile.
            found = self._read(name, target_context)
            if found is not None:
                self._unlock(name)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled for `sig`, in the first folder that takes it."""
        name = self._file_name(sig)
        try:
            content = dumps((sig, data._reduce()))
            for folder in writable_folders(self._package):
                with suppress(OSError):
                    write(folder / name, content)
                    used[name] = DIGEST_BYTES + len(content)
                    return
            _warn_once()
        finally:
            self._unlock(name)

    def enable(self) -> None:
        """Nothing: it always is."""

    def disable(self) -> None:
        """Nothing: it never is."""

    def flush(self) -> None:
        """Nothing: no index is kept."""

    def _file_name(self, sig: Any) -> str:
        digest = hashlib.blake2b(str(sig).encode(), digest_size=DIGEST_BYTES).hexdigest()
        return f"{self._name}.{digest}.kernel"

    def _read(self, name: str, target_context: Any) -> Any:
        for folder in folders(self._package):
            content = read(folder / name)
            if content is not None:
                # Whatever a file holds that was written whole by somebody else: not ours.
                with suppress(Exception):
                    _, compiled = pickle.loads(content)
                    found = CompileResult._rebuild(target_context, *compiled)
                    used[name] = DIGEST_BYTES + len(content)
                    return found
        return None

    def _lock(self, name: str) -> None:
        """Wait until no other process compiles this one, where the disk knows locks."""
        for folder in writable_folders(self._package):
            lock = filelock.FileLock(folder / f"{name}.lock", PATIENCE_SECONDS)
            with suppress(OSError, NotImplementedError):
                lock.acquire()
                self._locks[name] = lock
                return

    def _unlock(self, name: str) -> None:
        if lock := self._locks.pop(name, None):
            lock.release()


@lru_cache  # Python's own memory of what it warned of is lost as Numba changes the filters
def _warn_once() -> None:
    text = "kernels are compiled in every process: no folder takes them"
    warnings.warn(text, KernelsNotKept, stacklevel=1)


def write(file: Path, content: bytes) -> None:
    """Write a file whole or not at all, with a digest that `read` checks.

    Raises:
        OSError: the disk does not take it.
    """
    temporary = file.with_name(f"{file.name}.{os.getpid()}")
    try:
        temporary.write_bytes(_digest(content) + content)
        temporary.replace(file)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def read(file: Path) -> bytes | None:
    """Return what `write` wrote; None if there is nothing, or it is damaged."""
    try:
        whole = file.read_bytes()
    except OSError:
        return None
    digest, content = whole[:DIGEST_BYTES], whole[DIGEST_BYTES:]
    return content if digest == _digest(content) else None


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()


def signature(content: bytes) -> Any:
    """Return what a kept kernel was compiled for: the types of its arguments."""
    return pickle.loads(content)[0]


def folders(package: Path) -> list[Path]:
    """Return where kernels of `package` are looked for, the first place first."""
    return [SHIPPED / _version(package), *_own_folders(package)]


def writable_folders(package: Path) -> Iterator[Path]:
    """Yield where kernels of `package` may be written to; they exist by then."""
    for folder in _own_folders(package):
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            yield folder


def _own_folders(package: Path) -> list[Path]:
    return [base / _version(package) for base in _bases()]


def _bases() -> Iterator[Path]:
    """Yield the user's cache folder, and one of ours among the temporary ones."""
    user = Path(config.CACHE_DIR or platformdirs.user_cache_dir("breakaway"))
    if user.is_absolute():  # without a home it is not
        yield user
    with suppress(OSError):
        temporary = Path(tempfile.gettempdir()) / f"breakaway-{os.getuid()}"
        temporary.mkdir(mode=0o700, exist_ok=True)
        status = temporary.lstat()
        # Others may have made a folder of that name, and kernels are code.
        is_ours = status.st_uid == os.getuid() and not status.st_mode & (
            stat.S_IWGRP | stat.S_IWOTH
        )
        if is_ours and stat.S_ISDIR(status.st_mode):
            yield temporary


@lru_cache
def _version(package: Path) -> str:
    """Return a name that changes with the sources of a package, with the compiler and the CPU.

    An edited plant would otherwise live on inside a kept CEM.
    """
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    compiler = (platform.python_version(), version("numba"), version("llvmlite"))
    digest.update(repr((compiler, cpu_target.target_context.codegen().magic_tuple())).encode())
    for source in sorted(package.rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()
