"""The conditional 1D U-Net of the paper's Table 1.

A Conv1D over (B, C, L) is computed as a 2-D convolution of height one over (B, C, 1, L): the same
sums, but PyTorch's CPU convolutions have their fast channels-last path in 2-D only (a training
step takes 0.78 of the time).
"""

import math

import torch
from torch import Tensor, nn

from app.inference.checkpoint import GROUPS
from training.config import UNetConfig


def conv1d(in_channels: int, out_channels: int, kernel: int = 3, stride: int = 1) -> nn.Conv2d:
    """Return a Conv1D, in 2-D form, that keeps the length or divides it by `stride`."""
    padding = (kernel - stride) // 2
    return nn.Conv2d(
        in_channels, out_channels, (1, kernel), stride=(1, stride), padding=(0, padding)
    )


class TimeEmbedding(nn.Module):
    """Sinusoidal embedding of the diffusion time (Vaswani et al. 2017), then an MLP."""

    frequencies: Tensor

    def __init__(self, dimension: int) -> None:
        super().__init__()
        half = dimension // 2
        exponents = torch.arange(half, dtype=torch.float32) / max(half - 1, 1)
        self.register_buffer("frequencies", torch.exp(-math.log(10_000.0) * exponents))
        self.mlp = nn.Sequential(
            nn.Linear(dimension, dimension), nn.SiLU(), nn.Linear(dimension, dimension)
        )

    def forward(self, t: Tensor) -> Tensor:
        angles = t.to(torch.float32).unsqueeze(1) * self.frequencies.unsqueeze(0)
        embedding: Tensor = self.mlp(torch.cat([angles.sin(), angles.cos()], dim=1))
        return embedding


class ConditionEmbedding(nn.Module):
    """MLP over the condition; rows without one get a learned vector instead."""

    def __init__(self, size: int, dimension: int) -> None:
        super().__init__()
        self.mlp = nn.Sequential(
            nn.Linear(size, dimension), nn.SiLU(), nn.Linear(dimension, dimension)
        )
        self.null = nn.Parameter(torch.zeros(dimension))

    def forward(self, condition: Tensor, keep_condition: Tensor) -> Tensor:
        return torch.where(keep_condition.unsqueeze(1), self.mlp(condition), self.null)


class ResBlock1D(nn.Module):
    """Two pre-activated convolutions; the embeddings are added between them."""

    def __init__(self, channels: int, time_dimension: int, condition_dimension: int) -> None:
        super().__init__()
        self.norm1 = nn.GroupNorm(GROUPS, channels)
        self.conv1 = conv1d(channels, channels)
        self.time_projection = nn.Linear(time_dimension, channels)
        self.condition_projection = nn.Linear(condition_dimension, channels)
        self.norm2 = nn.GroupNorm(GROUPS, channels)
        self.conv2 = conv1d(channels, channels)
        self.activation = nn.SiLU()

    def forward(self, x: Tensor, time: Tensor, condition: Tensor) -> Tensor:
        shift = self.time_projection(self.activation(time)) + self.condition_projection(
            self.activation(condition)
        )
        h = self.conv1(self.activation(self.norm1(x))) + shift.unsqueeze(2).unsqueeze(3)
        h = self.conv2(self.activation(self.norm2(h)))
        out: Tensor = x + h
        return out


class UNet(nn.Module):
    """Noise predictor eps_theta(u_t, t, c) (paper, Eq. 3 and Table 1).

    Its parameters are those of `app.inference.checkpoint`.

    Args:
        config: the widths.
        condition_size: C, numbers of a condition.
    """

    def __init__(self, config: UNetConfig, condition_size: int) -> None:
        super().__init__()
        channels = config.channels
        widths = (channels, config.time_dimension, config.condition_dimension)
        self.time_embedding = TimeEmbedding(config.time_dimension)
        self.condition_embedding = ConditionEmbedding(condition_size, config.condition_dimension)
        self.input = conv1d(1, channels)
        self.encoder1 = ResBlock1D(*widths)
        self.encoder2 = ResBlock1D(*widths)
        self.downsampling = conv1d(channels, channels, kernel=4, stride=2)
        self.bottleneck1 = ResBlock1D(*widths)
        self.bottleneck2 = ResBlock1D(*widths)
        self.upsampling = nn.ConvTranspose2d(
            channels, channels, (1, 4), stride=(1, 2), padding=(0, 1)
        )
        self.decoder1 = ResBlock1D(*widths)
        self.decoder2 = ResBlock1D(*widths)
        self.output = conv1d(channels, 1)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, u_t: Tensor, t: Tensor, condition: Tensor, keep_condition: Tensor) -> Tensor:
        """Predict the noise in `u_t`.

        Args:
            u_t: (B, 1, H), noisy controls scaled to [-1, 1]; H even.
            t: (B,) int64, diffusion times from 0 to T-1.
            condition: (B, C), standardised.
            keep_condition: (B,) bool; False replaces the row's condition by the learned null one.

        Returns:
            (B, 1, H).
        """
        time = self.time_embedding(t)
        states = self.condition_embedding(condition, keep_condition)
        x = self.input(u_t.unsqueeze(2).contiguous(memory_format=torch.channels_last))
        x = self.encoder1(x, time, states)
        skip = self.encoder2(x, time, states)
        x = self.downsampling(skip)
        x = self.bottleneck1(x, time, states)
        x = self.bottleneck2(x, time, states)
        x = self.upsampling(x) + skip
        x = self.decoder1(x, time, states)
        x = self.decoder2(x, time, states)
        noise: Tensor = self.output(x).squeeze(2)
        return noise
