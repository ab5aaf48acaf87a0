"""Publishing a trained network: a version folder that appears in the model store whole or not."""

import csv
import hashlib
import platform
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numba
import numpy
import torch

from app.inference.manifest import CHECKPOINT_FILE, MANIFEST_FILE, Losses, Manifest, Prediction
from app.inference.torchscript import to_torchscript
from training.config import TrainingConfig
from training.trainer import LossRecord, Trainer

PREDICTED: dict[Prediction, str] = {
    "noise": "noise",
    "clean": "clean controls",
    "velocity": "velocity",
}
"""What networks predict, as the loss curve calls it."""


def version_directory(model_store: Path, config: TrainingConfig) -> Path:
    """Return where the version that `config` names belongs.

    Raises:
        FileExistsError: that version is published already; versions never change.
    """
    directory = model_store / config.name / str(config.version)
    if directory.exists():
        raise FileExistsError(f"{directory} exists; raise the version in the configuration")
    return directory


def export(trainer: Trainer, model_store: Path, log_file: Path) -> Path:
    """Write checkpoint, manifest, loss curve and log; return the new version folder.

    Raises:
        FileExistsError: that version is published already.
    """
    directory = version_directory(model_store, trainer.config)
    directory.parent.mkdir(parents=True, exist_ok=True)
    checkpoint = to_torchscript(trainer.averaged_network)
    history = trainer.progress.history
    with tempfile.TemporaryDirectory(dir=directory.parent, prefix=".export-") as parent:
        draft = Path(parent) / directory.name
        draft.mkdir(mode=0o755)
        (draft / CHECKPOINT_FILE).write_bytes(checkpoint)
        manifest = _manifest(trainer, hashlib.sha256(checkpoint).hexdigest())
        (draft / MANIFEST_FILE).write_text(manifest.model_dump_json(indent=1) + "\n")
        _write_loss_curve(history, trainer.config, draft)
        shutil.copyfile(log_file, draft / "training.log")
        draft.rename(directory)
    return directory


def _manifest(trainer: Trainer, sha256: str) -> Manifest:
    config, last = trainer.config, trainer.progress.history[-1]
    return Manifest(
        name=config.name,
        version=config.version,
        sha256=sha256,
        coverage=trainer.data.coverage,
        system=config.system,
        trained_on=trainer.data.description,
        horizon=config.data.horizon,
        kind=config.diffusion.kind,
        condition=trainer.data.conditioning,
        uncertainty=trainer.data.uncertainty._asdict() if any(trainer.data.uncertainty) else {},
        predicts=config.diffusion.predicts,
        samplers=config.samplers,
        alphas_cumprod=tuple(trainer.alphas_cumprod.tolist()),
        training=config.model_dump(mode="json"),
        seeds={"training": config.seed},
        losses=Losses(training=last.training, validation=last.validation),
        libraries={
            "python": platform.python_version(),
            "torch": torch.__version__,
            "numpy": numpy.__version__,
            "numba": numba.__version__,
        },
    )


def _write_loss_curve(
    history: Sequence[LossRecord], config: TrainingConfig, directory: Path
) -> None:
    with (directory / "loss.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["step", "training_loss", "validation_loss"])
        writer.writerows((r.step, f"{r.training:.6f}", f"{r.validation:.6f}") for r in history)
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    steps = [record.step for record in history]
    axes.plot(steps, [record.training for record in history], label="training")
    axes.plot(
        steps, [record.validation for record in history], label="validation (averaged weights)"
    )
    loss = f"mean-squared error of the {PREDICTED[config.diffusion.predicts]}"
    if config.optimisation.terminal_weight:
        loss += f"\nand {config.optimisation.terminal_weight:g} x terminal loss"
    axes.set(xlabel="gradient step", ylabel=loss, yscale="log")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(directory / "loss.png", dpi=150)
    plt.close(figure)
