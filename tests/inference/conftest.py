"""Stores of tiny models, written as training writes them."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import pytest
import torch

from app.inference.conditioning import Conditioning
from app.inference.manifest import CHECKPOINT_FILE, MANIFEST_FILE, Losses, Manifest
from app.inference.torchscript import to_torchscript
from app.planning.methods.sampler import Samplers, SamplerSettings
from app.planning.plant.coverage import Coverage
from app.planning.plant.system import System
from training.config import UNetConfig
from training.schedule import cosine_alphas_cumprod
from training.unet import UNet

Publish: TypeAlias = Callable[..., Path]
"""publish(name, version, **manifest fields): the new version folder."""
SAMPLERS = Samplers(
    dpm_solver=SamplerSettings(3, 2.0, first_time=0.7, last_time=0.25),
    ddim=SamplerSettings(4, 1.5, first_time=1.0, last_time=0.0),
)


def _checkpoint(seed: int) -> bytes:
    torch.manual_seed(seed)
    network = UNetConfig(kind="unet", channels=16, time_dimension=8, condition_dimension=8)
    return to_torchscript(UNet(network, condition_size=4))


@pytest.fixture(scope="session")
def checkpoint() -> bytes:
    return _checkpoint(seed=0)


@pytest.fixture(scope="session")
def other_checkpoint() -> bytes:
    return _checkpoint(seed=1)


@pytest.fixture
def store(tmp_path: Path) -> Path:
    directory = tmp_path / "store"
    directory.mkdir()
    return directory


@pytest.fixture(scope="session")
def publisher(checkpoint: bytes) -> Callable[[Path], Publish]:
    """Return the road to a `publish` for a store."""

    def publisher(store: Path) -> Publish:
        def publish(
            name: str = "tiny", version: int = 1, content: bytes = checkpoint, **fields: Any
        ) -> Path:
            directory = store / name / str(version)
            directory.mkdir(parents=True)
            (directory / CHECKPOINT_FILE).write_bytes(content)
            manifest = Manifest(
                **{
                    "name": name,
                    "version": version,
                    "sha256": hashlib.sha256(content).hexdigest(),
                    "coverage": Coverage.only(System()),
                    "system": System(),
                    "trained_on": "Nothing.",
                    "horizon": 64,
                    "predicts": "noise",
                    "samplers": SAMPLERS,
                    "condition": Conditioning.on_states((0.1, 0.2), (0.8, 0.4)),
                    "alphas_cumprod": tuple(cosine_alphas_cumprod(20).tolist()),
                    "training": {},
                    "seeds": {"training": 0},
                    "losses": Losses(training=0.1, validation=0.2),
                    "libraries": {},
                    **fields,
                }
            )
            (directory / MANIFEST_FILE).write_text(manifest.model_dump_json())
            return directory

        return publish

    return publisher


@pytest.fixture
def publish(publisher: Callable[[Path], Publish], store: Path) -> Publish:
    return publisher(store)
