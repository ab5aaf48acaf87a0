"""A model store with a tiny model: real training, real TorchScript, nothing learned."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from hypothesis import settings

from app.evaluation.entrants import PAPER_MODEL
from app.serving.kernels import ALL, prepare
from training.config import DEFAULT_CONFIG, TrainingConfig
from training.export import export
from training.trainer import Trainer

MODEL = "tiny"

# The first example of a test may compile a kernel.
settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")


@pytest.fixture(scope="session", autouse=True)
def kernels() -> None:
    """Compile all kernels on all cores, where the first test would on one."""
    prepare(ALL)


def tiny_config() -> TrainingConfig:
    config = TrainingConfig.read(DEFAULT_CONFIG).model_dump()
    config["name"] = MODEL
    config["data"] |= {"training_samples": 64, "validation_samples": 16}
    config["network"] = {
        "kind": "unet",
        "channels": 16,
        "time_dimension": 8,
        "condition_dimension": 8,
    }
    config["optimisation"] |= {"steps": 2, "batch_size": 32, "validation_interval": 2}
    return TrainingConfig.model_validate(config)


@pytest.fixture(scope="session")
def model_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that holds tiny/1."""
    folder = tmp_path_factory.mktemp("store")
    run = tmp_path_factory.mktemp("run")
    (run / "training.log").touch()
    trainer = Trainer(tiny_config(), run, torch.device("cpu"))
    trainer.run()
    export(trainer, folder, run / "training.log")
    return folder


@pytest.fixture(scope="session")
def paper_store(model_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that holds the tiny model under the name that the evaluation asks for."""
    folder = tmp_path_factory.mktemp("paper_store")
    version = shutil.copytree(model_store / MODEL / "1", folder / PAPER_MODEL / "1")
    manifest = json.loads((version / "manifest.json").read_text())
    (version / "manifest.json").write_text(json.dumps(manifest | {"name": PAPER_MODEL}))
    return folder
