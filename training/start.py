"""The weights of a shipped model, for a training that goes on from them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import torch
from torch import Tensor

from app.inference.conditioning import Conditioning
from app.inference.device import CPU
from app.inference.torchscript import read_torchscript
from app.inference.verification import ModelRejected, verify
from training.network import Denoiser

SHIPPED = Path(__file__).parents[1] / "model_store"
CONDITION_WEIGHT = "condition_embedding.mlp.0.weight"
"""Of the U-Net, (E, C): what it makes of each number of a condition."""


@dataclass(frozen=True, slots=True)
class StartingPoint:
    """A model that was trained before."""

    conditioning: Conditioning
    parameters: dict[str, Tensor]

    @classmethod
    def of(cls, label: str) -> Self:
        """Read a shipped model by its `name/version`.

        Raises:
            ValueError: there is none, or it is not what its manifest says.
        """
        try:
            manifest, content = verify(SHIPPED / label)
        except ModelRejected as error:
            raise ValueError(f"cannot start from {label}: {error}") from error
        script = read_torchscript(content, CPU)
        return cls(manifest.condition, dict(script.state_dict()))

    def fill(self, network: Denoiser) -> None:
        """Give a network these weights; numbers of the condition that come last weigh nothing.

        Raises:
            ValueError: the network has other layers.
        """
        parameters = dict(self.parameters)
        size = network.state_dict()[CONDITION_WEIGHT].shape[1]
        weight = parameters[CONDITION_WEIGHT]
        missing = size - weight.shape[1]
        parameters[CONDITION_WEIGHT] = torch.nn.functional.pad(weight, (0, missing))
        try:
            network.load_state_dict(parameters)
        except RuntimeError as error:
            raise ValueError(f"the model to start from has other layers: {error}") from error
