"""What a network is to the samplers, and the checkpoint's own TorchScript as one."""

from collections.abc import Callable
from typing import Protocol

from torch import Tensor

CONDITION_SIZE = 4


class Network(Protocol):
    """A noise predictor eps_theta(u_t, t, c) (paper, Eq. 3).

    Its rows have nothing to do with each other: each has its own controls, diffusion time and
    condition.
    """

    def embed(self, condition: Tensor) -> Tensor:
        """Return what the network makes of a condition, once for a whole sampling.

        Args:
            condition: (4,), standardised [x_0, x*].

        Returns:
            (2, E): with the condition, and with the learned null condition instead.
        """
        ...

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        """Predict the noise in `u_t` (B, H) at times `t` (B,) int64, embeddings (B, E); (B, H)."""
        ...


class ScriptedNetwork:
    """The checkpoint as it is: right for every network, on every device."""

    def __init__(self, unet: Callable[..., Tensor]) -> None:
        self._unet = unet

    def embed(self, condition: Tensor) -> Tensor:
        """Return the condition and whether to keep it; E = 5."""
        embedding = condition.new_zeros(2, CONDITION_SIZE + 1)
        embedding[0, :CONDITION_SIZE] = condition
        embedding[0, CONDITION_SIZE] = 1.0
        return embedding

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        """Predict the noise, as `Network.predict`."""
        condition, keep = embedding[:, :CONDITION_SIZE], embedding[:, CONDITION_SIZE] > 0
        noise: Tensor = self._unet(u_t.unsqueeze(1), t, condition, keep)
        return noise[:, 0]
