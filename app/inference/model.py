"""A model: a verified checkpoint, and the network that runs it."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from app.inference.manifest import Manifest
from app.inference.model_card import GUESS, ModelCard, Pace
from app.inference.networks import Kind, build_network
from app.inference.networks.base import Checkpoint, Network
from app.inference.noise_levels import NoiseLevel, noise_levels
from app.inference.pace import measure_pace
from app.inference.row_threads import RowThreads
from app.inference.torchscript import read_torchscript
from app.inference.verification import ModelRejected
from app.planning.plant.spread import CERTAIN, Spread
from app.planning.problem import Problem


@dataclass(frozen=True, slots=True, eq=False)
class Model(ModelCard):
    """A verified checkpoint, loaded on a device."""

    network: Network
    num_parameters: int
    """Of the checkpoint."""
    device: torch.device
    noise_levels: Sequence[NoiseLevel]
    """At each diffusion time, and last without noise."""

    def condition(self, problem: Problem, spread: Spread = CERTAIN) -> torch.Tensor:
        """Return what the network knows of a problem and of how far its plant may be off, (C,)."""
        return torch.from_numpy(self.manifest.encode(problem, spread)).to(self.device)


def load_model(
    manifest: Manifest,
    content: bytes,
    device: torch.device,
    threads: RowThreads,
    kinds: Sequence[Kind],
    serving: Sequence[Model] | None,
) -> Model:
    """Load and warm up a verified checkpoint, unless it serves already; see `ModelStore.load`.

    Raises:
        ModelRejected: it does not run.
    """
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
        network = build_network(checkpoint, threads, manifest.name, kinds)
        pace = (
            measure_pace(network, condition_size, horizon, device)
            if serving is None
            else _pace_of_one_like(network, num_parameters, horizon, serving)
        )
    except RuntimeError as error:
        raise ModelRejected(f"{manifest.label}: the checkpoint does not run: {error}") from error
    levels = noise_levels(manifest.kind, manifest.alphas_cumprod)
    return Model(manifest, pace, network, num_parameters, device, levels)


def _pace_of_one_like(
    network: Network, num_parameters: int, horizon: int, serving: Sequence[Model]
) -> Pace:
    """Return the pace of a model whose network is of the same kind and size, or a guess."""
    for model in serving:
        size = (model.num_parameters, model.manifest.horizon)
        if type(model.network) is type(network) and size == (num_parameters, horizon):
            return model.pace
    return GUESS
