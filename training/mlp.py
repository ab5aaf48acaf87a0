"""A residual MLP in the place of the U-Net: a tenth of its work, for one horizon."""

import torch
from torch import Tensor, nn

from training.config import MLPConfig
from training.unet import TimeEmbedding


class ResidualBlock(nn.Module):
    """x + W2 silu(W1 LayerNorm(x)), pre-activated as the blocks of the U-Net."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.first = nn.Linear(width, width)
        self.second = nn.Linear(width, width)
        self.activation = nn.SiLU()

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = x + self.second(self.activation(self.first(self.norm(x))))
        return out


class MLP(nn.Module):
    """A network with the arguments and the result of `UNet`, over all steps at once.

    The time's and the condition's embedding are added to that of the controls; a row without a
    condition has zeros in its place, and says so.

    Args:
        config: the sizes.
        condition_size: C, numbers of a condition.
        horizon: H, the only one that it takes.
    """

    def __init__(self, config: MLPConfig, condition_size: int, horizon: int) -> None:
        super().__init__()
        width = config.width
        self.time_embedding = TimeEmbedding(config.time_dimension)
        self.condition_embedding = nn.Sequential(
            nn.Linear(config.time_dimension + condition_size + 1, width),
            nn.SiLU(),
            nn.Linear(width, width),
        )
        self.input = nn.Linear(horizon, width)
        self.blocks = nn.ModuleList(ResidualBlock(width) for _ in range(config.blocks))
        self.output = nn.Sequential(nn.LayerNorm(width), nn.SiLU(), nn.Linear(width, horizon))

    def forward(self, u_t: Tensor, t: Tensor, condition: Tensor, keep_condition: Tensor) -> Tensor:
        """Predict as `UNet.forward` does; H is the horizon."""
        kept = keep_condition.to(condition.dtype).unsqueeze(1)
        known = torch.cat([self.time_embedding(t), condition * kept, kept], dim=1)
        x = self.input(u_t.squeeze(1)) + self.condition_embedding(known)
        for block in self.blocks:
            x = block(x)
        predicted: Tensor = self.output(x).unsqueeze(1)
        return predicted
