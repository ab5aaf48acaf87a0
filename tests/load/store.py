"""A model store that changes while it is served: models to load, to fail, and to refuse."""

import hashlib
import shutil
from pathlib import Path

import torch
from torch import Tensor

from app.inference.manifest import CHECKPOINT_FILE, MANIFEST_FILE, Manifest
from app.inference.torchscript import to_torchscript
from app.settings import SHIPPED_MODELS
from training.config import UNetConfig
from training.unet import UNet

SHIPPED = "dry-friction-fs0.7"
RELOADED, RAISES, NAN = "reloaded", "raises", "nan"


class _Raises(torch.nn.Module):
    """Passes the loader's trial, which is at time zero, and nothing else."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        if bool((t > 0).any()):
            raise RuntimeError("this model was made to fail")
        return u


class _GivesNan(torch.nn.Module):
    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return torch.where((t > 0).view(-1, 1, 1), torch.full_like(u, float("nan")), u)


class ChangingStore:
    """The shipped model, two that fail, and one whose version N is replaced by N+1.

    Versions of it have one of two sets of weights, in turn: see `weights_of`.

    Args:
        folder: empty; holds the store and what is on its way there.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "store"
        self._drafts = folder / "drafts"
        self._drafts.mkdir()
        self._manifest = Manifest.read(SHIPPED_MODELS / SHIPPED / "1" / MANIFEST_FILE)
        self._weights = [_network(seed) for seed in (0, 1)]
        self.version = 1
        shipped = (SHIPPED_MODELS / SHIPPED / "1" / CHECKPOINT_FILE).read_bytes()
        self._publish(SHIPPED, 1, shipped)
        self._publish(RAISES, 1, to_torchscript(_Raises()))
        self._publish(NAN, 1, to_torchscript(_GivesNan()))
        self._publish(RELOADED, self.version, self._weights[weights_of(self.version)])

    def replace(self) -> None:
        """Put the next version in the place of the one that is there."""
        self.version += 1
        self._publish(RELOADED, self.version, self._weights[weights_of(self.version)])
        self._remove(self.version - 1)

    def add_broken(self) -> None:
        """Add a version that is not what its manifest says."""
        self._publish(RELOADED, self.version + 1, b"damaged", hashed=b"whole")

    def remove_broken(self) -> None:
        self._remove(self.version + 1)

    def _publish(
        self, name: str, version: int, checkpoint: bytes, hashed: bytes | None = None
    ) -> None:
        """Write a version folder elsewhere, and put it in its place when it is whole."""
        draft = self._drafts / f"{name}-{version}"
        draft.mkdir()
        sha256 = hashlib.sha256(hashed or checkpoint).hexdigest()
        manifest = self._manifest.model_copy(
            update={"name": name, "version": version, "sha256": sha256}
        )
        (draft / CHECKPOINT_FILE).write_bytes(checkpoint)
        (draft / MANIFEST_FILE).write_text(manifest.model_dump_json())
        (self.path / name).mkdir(parents=True, exist_ok=True)
        draft.rename(self.path / name / str(version))

    def _remove(self, version: int) -> None:
        removed = (self.path / RELOADED / str(version)).rename(self._drafts / "removed")
        shutil.rmtree(removed)


def weights_of(version: int) -> int:
    """Return which set of weights a version of the changing model has."""
    return version % 2


def _network(seed: int) -> bytes:
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        config = UNetConfig(kind="unet", channels=16, time_dimension=8, condition_dimension=8)
        return to_torchscript(UNet(config, condition_size=4))
