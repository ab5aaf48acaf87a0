"""An image built with buildah, which needs no engine, and what it consists of."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
"""Of this machine, which may reach package registries through a proxy of its own."""
DEBIAN = "bookworm"
PACKAGES = "python3,python3-venv,python3-pip,ca-certificates"


class Layer(NamedTuple):
    """A layer of an image."""

    command: str
    """That made it."""
    size: int
    """Bytes, unpacked."""


class Buildah:
    """Buildah with a storage of its own.

    Args:
        folder: for images, and for what they are made of.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._command = ["buildah", "--root", f"{folder}/storage", "--runroot", f"{folder}/run"]

    def __call__(self, *arguments: str | Path) -> str:
        """Run a command of buildah's; return what it prints."""
        done = subprocess.run(
            [*self._command, *map(str, arguments)],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"BUILDAH_ISOLATION": "chroot"},
        )
        printed: str = done.stdout
        return printed.strip()

    def debian(self) -> str:
        """Make a base image of Debian's packages, unless there is one; return its name."""
        if not self("images", "--quiet", "--filter", "reference=localhost/base"):
            root = self._folder / "base"
            if not root.exists():
                subprocess.run(
                    ["debootstrap", "--variant=minbase", f"--include={PACKAGES}", DEBIAN, root],
                    check=True,
                )
                subprocess.run(["chroot", root, "apt-get", "clean"], check=True)
                shutil.rmtree(root / "var/lib/apt/lists")
            container = self("from", "scratch")
            self("add", "--quiet", container, root, "/")
            self("commit", "--quiet", "--format", "docker", "--rm", container, "base")
        return "localhost/base"

    def build(self, base_image: str, wheel_index: str, extra: str = "") -> None:
        """Build the image `breakaway` of the clone in this directory; tells how far it is."""
        folders = [path for path in (wheel_index, str(CERTIFICATES)) if Path(path).exists()]
        revision = subprocess.run(
            ["git", "rev-parse", "HEAD"], check=True, capture_output=True, text=True
        ).stdout.strip()
        arguments = {
            "BASE_IMAGE": base_image,
            "WHEEL_INDEX": wheel_index,
            "REVISION": revision,
            "EXTRA": extra,
        }
        subprocess.run(
            [
                *self._command,
                *("build", "--isolation", "chroot", "--format", "docker", "--network", "host"),
                *("--layers", "--tag", "breakaway"),
                *(f"--build-arg={name}={value}" for name, value in arguments.items()),
                *(f"--volume={folder}:{folder}:ro" for folder in folders),
                ".",
            ],
            check=True,
        )

    def config(self) -> dict[str, Any]:
        """Return the image's configuration: Env, User, Entrypoint, Labels and so on."""
        config: dict[str, Any] = self._inspect()["Docker"]["config"]
        return config

    def layers(self) -> list[Layer]:
        """List the image's layers, from the base up."""
        about = self._inspect()
        commands = [
            step["created_by"]
            for step in about["Docker"]["history"]
            if not step.get("empty_layer", False)
        ]
        sizes = [layer["size"] for layer in json.loads(about["Manifest"])["layers"]]
        return [Layer(*layer) for layer in zip(commands, sizes, strict=True)]

    @contextmanager
    def mounted(self) -> Iterator[Path]:
        """Make a container of the image; yield where its files are, until the context ends."""
        name = self("from", "breakaway")
        try:
            yield Path(self("mount", name))
        finally:
            self("umount", name)
            self("rm", name)

    def _inspect(self) -> Any:
        return json.loads(self("inspect", "--type", "image", "breakaway"))
