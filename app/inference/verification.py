"""The files of a model store: finding and verifying them, without running what they hold.

A store is `<name>/<version>/unet.pt` + `manifest.json`. No torch in here: models can be listed and
checked without loading it.
"""

import hashlib
import re
from pathlib import Path

from pydantic import ValidationError

from app.inference.manifest import CHECKPOINT_FILE, MANIFEST_FILE, Manifest

VERSION = re.compile(r"[1-9][0-9]*")


class ModelRejected(Exception):
    """A checkpoint or its manifest is missing, damaged or not what its manifest says."""


def find_versions(directory: Path) -> list[Path]:
    """Return the version folders of a store: every `<name>/<number>` with a manifest.

    Raises:
        ModelRejected: the store is not a directory.
    """
    if not directory.is_dir():
        raise ModelRejected(f"the model store {directory} is not a directory")
    return sorted(
        manifest.parent
        for manifest in directory.glob(f"*/*/{MANIFEST_FILE}")
        if VERSION.fullmatch(manifest.parent.name)
    )


def find_skipped(directory: Path) -> list[str]:
    """Return what in a store looks like a model but is none, a line each that says why.

    Hidden folders are drafts, and nobody's concern.
    """
    lines = [
        f"{manifest.parent.name} ({MANIFEST_FILE} belongs in the folder of a version)"
        for manifest in directory.glob(f"[!.]*/{MANIFEST_FILE}")
    ]
    for folder in directory.glob("[!.]*/[!.]*/"):
        label = f"{folder.parent.name}/{folder.name}"
        has_manifest = (folder / MANIFEST_FILE).exists()
        if VERSION.fullmatch(folder.name) and not has_manifest:
            lines.append(f"{label} (no {MANIFEST_FILE})")
        elif has_manifest and not VERSION.fullmatch(folder.name):
            lines.append(f"{label} (a version is a number, from 1 on)")
    return sorted(lines)


def verify(directory: Path) -> tuple[Manifest, bytes]:
    """Read a version folder; return its manifest and the checkpoint's bytes, unexecuted.

    The bytes that were hashed are the bytes to load: TorchScript is executable code.

    Raises:
        ModelRejected: a file cannot be read, the manifest is invalid or names another model, or
            the checkpoint's sha256 is not the manifest's.
    """
    try:
        manifest = Manifest.read(directory / MANIFEST_FILE)
        checkpoint = (directory / CHECKPOINT_FILE).read_bytes()
    except (OSError, ValidationError) as error:
        raise ModelRejected(f"{directory}: {error}") from error
    if (manifest.name, str(manifest.version)) != (directory.parent.name, directory.name):
        raise ModelRejected(f"{directory}: the manifest is of {manifest.label}")
    digest = hashlib.sha256(checkpoint).hexdigest()
    if digest != manifest.sha256:
        raise ModelRejected(
            f"{directory / CHECKPOINT_FILE}: sha256 is {digest}, the manifest says "
            f"{manifest.sha256}; the file was changed or damaged, and was not loaded"
        )
    return manifest, checkpoint
