"""The model store: loading verified checkpoints, and finding the model that a request needs.

All that knows of TorchScript is here.
"""

import io
import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch

from app.inference.manifest import Manifest
from app.inference.networks.base import CONDITION_SIZE, Network
from app.inference.networks.compiled import UnsuitableNetwork, derive
from app.inference.networks.scripted import ScriptedNetwork
from app.inference.pace import Pace, measure_pace
from app.inference.row_threads import RowThreads
from app.inference.verification import ModelRejected, find_versions, verify
from app.planning.plant.system import System
from app.planning.problem import Problem

log = logging.getLogger(__name__)


class UnknownModel(LookupError):
    """No such model, or no such version of it, in the store."""


class UnfitModel(LookupError):
    """No model was trained for the asked-for plant and horizon."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A verified checkpoint, loaded on a device."""

    manifest: Manifest
    network: Network
    device: torch.device
    pace: Pace

    @property
    def label(self) -> str:
        """`name/version`, as requests name it."""
        return f"{self.manifest.name}/{self.manifest.version}"

    def fits(self, system: System, horizon: int) -> bool:
        """Say whether the model was trained for this plant and horizon."""
        return (self.manifest.system, self.manifest.horizon) == (system, horizon)

    def condition(self, problem: Problem) -> torch.Tensor:
        """Return what the network knows of a problem: standardised [x_0, x*], (4,)."""
        states = np.stack([problem.initial_state, problem.target_state])
        standardised = (states - self.manifest.state_mean) / self.manifest.state_std
        return torch.tensor(standardised.ravel(), dtype=torch.float32, device=self.device)


class ModelStore:
    """The models of a service, by name and version."""

    def __init__(self, models: list[Model]) -> None:
        self.models = sorted(models, key=lambda m: (m.manifest.name, -m.manifest.version))

    @classmethod
    def load(
        cls,
        directory: Path,
        device: torch.device,
        threads: RowThreads,
        loaded: Sequence[Model] = (),
    ) -> Self:
        """Verify every model under `directory`, load and warm up those that are not yet `loaded`.

        Args:
            directory: the store.
            device: where the networks run.
            threads: share out the rows on a CPU.
            loaded: models that are kept if the store still holds the very same.

        Raises:
            ModelRejected: one of them is not what its manifest says; none is loaded then.
        """
        return cls([_load(path, device, threads, loaded) for path in find_versions(directory)])

    def find(self, reference: str) -> Model:
        """Return the model called `name` (its latest version) or `name/version`.

        Raises:
            UnknownModel: there is none.
        """
        for model in self.models:
            if reference in (model.manifest.name, model.label):
                return model
        raise UnknownModel(f"no model {reference!r}; there are: {self._labels()}")

    def fitting(self, system: System, horizon: int) -> Model:
        """Return the first model by name, in its latest version, that fits plant and horizon.

        Raises:
            UnfitModel: there is none.
        """
        for model in self.models:
            if model.fits(system, horizon):
                return model
        raise UnfitModel(
            f"no model was trained for {system} and horizon {horizon}; there are: {self._labels()}"
        )

    def _labels(self) -> str:
        return ", ".join(model.label for model in self.models) or "none"


def read_torchscript(checkpoint: bytes, device: torch.device) -> torch.jit.ScriptModule:
    """Return a checkpoint's network.

    Raises:
        RuntimeError: the bytes are no TorchScript.
    """
    with warnings.catch_warnings():
        # TorchScript is the checkpoint contract; its deprecation is known and planned for.
        warnings.filterwarnings("ignore", r".*torch\.jit\..*deprecated", DeprecationWarning)
        script: torch.jit.ScriptModule = torch.jit.load(  # type: ignore[no-untyped-call]
            io.BytesIO(checkpoint), map_location=device
        )
        return script.eval()


def _load(
    directory: Path, device: torch.device, threads: RowThreads, loaded: Sequence[Model]
) -> Model:
    manifest, checkpoint = verify(directory)
    for model in loaded:
        # The manifest holds the checkpoint's hash.
        if model.manifest == manifest:
            return model
    try:
        script = read_torchscript(checkpoint, device)
        scripted = ScriptedNetwork(script, threads)
        _try(scripted, manifest.horizon, device)
        network = _fastest(script, scripted, manifest, device, threads)
        pace = measure_pace(network, manifest.horizon, device)
    except RuntimeError as error:
        raise ModelRejected(f"{directory}: the checkpoint does not run: {error}") from error
    return Model(manifest, network, device, pace)


@torch.inference_mode()
def _fastest(
    script: torch.jit.ScriptModule,
    scripted: ScriptedNetwork,
    manifest: Manifest,
    device: torch.device,
    threads: RowThreads,
) -> Network:
    """Return the compiled kernel where there is one for the checkpoint, or the checkpoint."""
    if device.type != "cpu":
        return scripted
    try:
        network = derive(script, scripted, manifest.horizon, len(manifest.alphas_cumprod), threads)
    except UnsuitableNetwork as error:
        log.warning("%s runs as TorchScript, slowly: %s", manifest.name, error)
        return scripted
    _try(network, manifest.horizon, device)
    return network


@torch.inference_mode()
def _try(network: Network, horizon: int, device: torch.device) -> None:
    """Run the network often enough for its executor to profile, optimise and settle.

    Raises:
        RuntimeError: the network fails or answers in the wrong shape.
    """
    controls = torch.zeros(2, horizon, device=device)
    embedding = network.embed(torch.zeros(CONDITION_SIZE, device=device))
    for _ in range(3):
        noise = network.predict(
            controls, torch.zeros(2, dtype=torch.int64, device=device), embedding
        )
        if noise.shape != controls.shape:
            raise RuntimeError(f"the output has shape {tuple(noise.shape)}")
