"""What a network is to the engine, and from what one is built."""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


class Network(Protocol):
    """Predicts of (u_t, t, c) what its manifest says: in the paper the noise (Eq. 3).

    Its rows have nothing to do with each other: each has its own controls, diffusion time and
    condition.
    """

    def embed(self, condition: Tensor) -> Tensor:
        """Return what the network makes of a condition, once for a whole sampling.

        Args:
            condition: (C,), standardised.

        Returns:
            (2, E): with the condition, and with the learned null condition instead.
        """
        ...

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        """Predict of `u_t` (B, H) at times `t` (B,) int64, embeddings (B, E); (B, H)."""
        ...


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A checkpoint's network as it was read, and what its manifest says of its arguments."""

    script: torch.jit.ScriptModule
    """In evaluation mode."""
    device: torch.device
    horizon: int
    num_timesteps: int
    """T."""
    condition_size: int
    """C."""


class UnsuitableNetwork(ValueError):
    """The checkpoint's network is not one that this kind of network can run."""


class AnotherNetwork(UnsuitableNetwork):
    """The checkpoint's network is of quite another make, and nothing is wrong with it."""
