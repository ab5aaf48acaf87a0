"""What a network is to the engine."""

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
