"""Run an image's files as a container would: its own root, processes, user and /tmp.

What no engine is at hand for is done by the kernel's own means; the network is this machine's.
"""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import psutil

from app.launch import free_port

START_SECONDS = 120

# $1: the root; $2: ro or rw; $3: user:group; $4: what cpu.max says; $5: models, or nothing
ENTER = """
root=$1 access=$2 user=$3 cpus=$4 models=$5; shift 5
mount --bind "$root" "$root" && cd "$root"
mount --rbind /dev "$root/dev"
mount -t proc proc "$root/proc"
mount -t tmpfs -o mode=1777 tmpfs "$root/tmp"
mount -t tmpfs tmpfs "$root/sys"
mkdir -p "$root/sys/fs/cgroup" && echo "$cpus" > "$root/sys/fs/cgroup/cpu.max"
test -z "$models" || mount --bind "$models" "$root/models"
mount -o "remount,bind,$access" "$root"
exec chroot --userspec="$user" --groups= "$root" "$@"
"""


class Image(NamedTuple):
    """An image whose files are mounted."""

    root: Path
    config: dict[str, Any]

    def command(
        self,
        *arguments: str,
        user: str,
        access: str = "ro",
        cpus: str = "max 100000",
        models: str = "",
        **environment: str,
    ) -> list[str]:
        """Return the command that runs `arguments` in the image, as process 1."""
        variables = [*self.config["Env"], *(f"{k}={v}" for k, v in environment.items())]
        return [
            *("unshare", "--mount", "--pid", "--fork", "sh", "-ec", ENTER, "sh"),
            *(str(self.root), access, user, cpus, models),
            *("env", "-i", *variables, *arguments),
        ]

    def run(self, *arguments: str, user: str, **options: str) -> int:
        """Run `arguments` in the image; return their exit status."""
        return subprocess.run(
            self.command(*arguments, user=user, **options), check=False
        ).returncode


class Served(NamedTuple):
    """A service in its container."""

    url: str
    process: "subprocess.Popen[bytes]"
    start_seconds: float
    """From its first process until it was ready."""

    @property
    def first(self) -> psutil.Process:
        """Process 1 of the container."""
        (child,) = psutil.Process(self.process.pid).children()
        return child

    def core_seconds(self) -> float:
        """Return what it has taken of processors so far, user's and system's time."""
        everybody = [self.first, *self.first.children(recursive=True)]
        return sum(sum(process.cpu_times()[:4]) for process in everybody)  # the fifth is waiting

    def written(self) -> list[Path]:
        """List what it has written to its /tmp."""
        tmp = Path(f"/proc/{self.first.pid}/root/tmp")
        return [path.relative_to(tmp) for path in tmp.rglob("*")]

    def tell_to_end(self) -> None:
        """Send what an engine sends."""
        os.kill(self.first.pid, signal.SIGTERM)


def serving(image: Image, user: str, **options: str) -> AbstractContextManager[Served]:
    """Run the image's own command until the context ends.

    Raises:
        TimeoutError: it does not become ready.
    """
    port = free_port()
    command = image.config["Entrypoint"] + image.config["Cmd"]
    return ready(image.command(*command, user=user, **options, BREAKAWAY_PORT=str(port)), port)


@contextmanager
def ready(command: list[str], port: int) -> Iterator[Served]:
    """Run a command that serves on a port, until the context ends.

    Args:
        command: as `Image.command` makes it.
        port: where it listens.

    Raises:
        TimeoutError: it does not become ready.
    """
    started = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            url = f"http://127.0.0.1:{port}"
            while not _is_ready(url):
                if time.perf_counter() > started + START_SECONDS or process.poll() is not None:
                    raise TimeoutError("the service did not become ready")
                time.sleep(0.05)
            yield Served(url, process, time.perf_counter() - started)
        finally:  # the first process has another user by now, and outlives its parent
            if process.poll() is None:
                for child in psutil.Process(process.pid).children():
                    child.kill()


def _is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz", trust_env=False).is_success
    except httpx.TransportError:
        return False
