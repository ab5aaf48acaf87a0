"""The model store: loading verified checkpoints, and finding the model that a request needs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import torch

from app.inference.manifest import Manifest
from app.inference.networks import build_network
from app.inference.networks.base import Checkpoint, Network
from app.inference.pace import GUESS, Pace, measure_pace
from app.inference.row_threads import RowThreads
from app.inference.torchscript import read_torchscript
from app.inference.verification import ModelRejected, find_versions, verify
from app.planning.plant.system import System
from app.planning.problem import Problem


class UnknownModel(LookupError):
    """No such model, or no such version of it, in the store."""


class UnfitModel(LookupError):
    """No model covers the asked-for plant and horizon."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A verified checkpoint, loaded on a device."""

    manifest: Manifest
    network: Network
    num_parameters: int
    """Of the checkpoint."""
    device: torch.device
    pace: Pace

    @property
    def label(self) -> str:
        """`name/version`, as requests name it."""
        return f"{self.manifest.name}/{self.manifest.version}"

    @property
    def coverage(self) -> str:
        """The plants and the horizon that the model was trained for, in words."""
        return f"plants with {self.manifest.plants}, and horizon {self.manifest.horizon}"

    def covers(self, system: System, horizon: int) -> bool:
        """Say whether the model was trained for such a plant and horizon."""
        return self.manifest.plants.covers(system) and self.manifest.horizon == horizon

    def condition(self, problem: Problem) -> torch.Tensor:
        """Return what the network knows of a problem, (C,)."""
        return torch.from_numpy(self.manifest.condition.encode(problem)).to(self.device)


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
        serving: Sequence[Model] | None = None,
    ) -> Self:
        """Verify every model under `directory`, load and warm up those that do not serve yet.

        Args:
            directory: the store.
            device: where the networks run.
            threads: share out the rows on a CPU.
            serving: models that are kept if the store still holds the very same; what is new is
                not timed beside them. None at the first start, when nobody is served yet.

        Raises:
            ModelRejected: one of them is not what its manifest says; none is loaded then.
        """
        return cls([_load(path, device, threads, serving) for path in find_versions(directory)])

    def find(self, reference: str) -> Model:
        """Return the model called `name` (its latest version) or `name/version`.

        Raises:
            UnknownModel: there is none.
        """
        for model in self.models:
            if reference in (model.manifest.name, model.label):
                return model
        raise UnknownModel(f"no model {reference!r}; there are: {self._labels()}")

    def covering(self, system: System, horizon: int) -> Model:
        """Return the first model by name, in its latest version, that covers plant and horizon.

        Raises:
            UnfitModel: there is none.
        """
        for model in self.models:
            if model.covers(system, horizon):
                return model
        there_are = "; ".join(f"{model.label} for {model.coverage}" for model in self.models)
        raise UnfitModel(
            f"no model was trained for {system} and horizon {horizon}; "
            f"there are: {there_are or 'none'}"
        )

    def _labels(self) -> str:
        return ", ".join(model.label for model in self.models) or "none"


def _load(
    directory: Path, device: torch.device, threads: RowThreads, serving: Sequence[Model] | None
) -> Model:
    manifest, content = verify(directory)
    for model in serving or ():
        # The manifest holds the checkpoint's hash.
        if model.manifest == manifest:
            return model
    horizon, condition_size = manifest.horizon, manifest.condition.size
    try:
        script = read_torchscript(content, device)
        num_parameters = sum(parameter.numel() for parameter in script.parameters())
        checkpoint = Checkpoint(
            script, device, horizon, len(manifest.alphas_cumprod), condition_size
        )
        network = build_network(checkpoint, threads, manifest.name)
        pace = (
            measure_pace(network, condition_size, horizon, device)
            if serving is None
            else _pace_of_one_like(network, num_parameters, horizon, serving)
        )
    except RuntimeError as error:
        raise ModelRejected(f"{directory}: the checkpoint does not run: {error}") from error
    return Model(manifest, network, num_parameters, device, pace)


def _pace_of_one_like(
    network: Network, num_parameters: int, horizon: int, serving: Sequence[Model]
) -> Pace:
    """Return the pace of a model whose network is of the same kind and size, or a guess."""
    for model in serving:
        size = (model.num_parameters, model.manifest.horizon)
        if type(model.network) is type(network) and size == (num_parameters, horizon):
            return model.pace
    return GUESS
