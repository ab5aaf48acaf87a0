"""The reference: the paper's network and sampler, written plainly in eager PyTorch."""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn

from app.inference.manifest import Manifest
from app.inference.solvers import CLEAN, even_times

STEPS = 50
GUIDANCE_SCALE = 2.0


class ResidualBlock(nn.Module):
    """Two pre-activated convolutions, the embeddings added between them."""

    def __init__(self, channels: int, time_dimension: int, condition_dimension: int) -> None:
        super().__init__()
        self.norm1 = nn.GroupNorm(8, channels)
        self.conv1 = nn.Conv1d(channels, channels, 3, padding=1)
        self.time_projection = nn.Linear(time_dimension, channels)
        self.condition_projection = nn.Linear(condition_dimension, channels)
        self.norm2 = nn.GroupNorm(8, channels)
        self.conv2 = nn.Conv1d(channels, channels, 3, padding=1)
        self.activation = nn.SiLU()

    def forward(self, x: Tensor, time: Tensor, condition: Tensor) -> Tensor:
        h = self.conv1(self.activation(self.norm1(x)))
        h = h + self.time_projection(self.activation(time)).unsqueeze(2)
        h = h + self.condition_projection(self.activation(condition)).unsqueeze(2)
        out: Tensor = x + self.conv2(self.activation(self.norm2(h)))
        return out


class PaperUNet(nn.Module):
    """The conditional 1D U-Net (paper, Table 1), with a checkpoint's weights.

    Args:
        weights: of the checkpoint, whose convolutions are in 2-D form.
    """

    frequencies: Tensor

    def __init__(self, weights: dict[str, Tensor]) -> None:
        super().__init__()
        channels = len(weights["input.bias"])
        time_dimension = len(weights["time_embedding.mlp.2.bias"])
        condition_dimension = len(weights["condition_embedding.null"])
        widths = (channels, time_dimension, condition_dimension)
        self.register_buffer("frequencies", torch.empty(time_dimension // 2))
        self.time_mlp = nn.Sequential(
            nn.Linear(time_dimension, time_dimension),
            nn.SiLU(),
            nn.Linear(time_dimension, time_dimension),
        )
        self.condition_mlp = nn.Sequential(
            nn.Linear(4, condition_dimension),
            nn.SiLU(),
            nn.Linear(condition_dimension, condition_dimension),
        )
        self.null = nn.Parameter(torch.empty(condition_dimension))
        self.input = nn.Conv1d(1, channels, 3, padding=1)
        self.encoder1 = ResidualBlock(*widths)
        self.encoder2 = ResidualBlock(*widths)
        self.downsampling = nn.Conv1d(channels, channels, 4, stride=2, padding=1)
        self.bottleneck1 = ResidualBlock(*widths)
        self.bottleneck2 = ResidualBlock(*widths)
        self.upsampling = nn.ConvTranspose1d(channels, channels, 4, stride=2, padding=1)
        self.decoder1 = ResidualBlock(*widths)
        self.decoder2 = ResidualBlock(*widths)
        self.output = nn.Conv1d(channels, 1, 3, padding=1)
        self.load_state_dict({_name(n): w.reshape(_shape(w)) for n, w in weights.items()})
        self.eval()

    def forward(self, u_t: Tensor, t: Tensor, condition: Tensor | None) -> Tensor:
        """Predict the noise (B, 1, H) in `u_t` (B, 1, H); `condition` (B, 4), or None."""
        angles = t.float().unsqueeze(1) * self.frequencies
        time = self.time_mlp(torch.cat([angles.sin(), angles.cos()], dim=1))
        states = (
            self.null.expand(len(t), -1) if condition is None else self.condition_mlp(condition)
        )
        x = self.encoder1(self.input(u_t), time, states)
        skip = self.encoder2(x, time, states)
        x = self.bottleneck1(self.downsampling(skip), time, states)
        x = self.bottleneck2(x, time, states)
        x = self.decoder1(self.upsampling(x) + skip, time, states)
        noise: Tensor = self.output(self.decoder2(x, time, states))
        return noise


def _name(name: str) -> str:
    """Return the name here of a checkpoint's weight."""
    for theirs, ours in (
        ("time_embedding.frequencies", "frequencies"),
        ("time_embedding.mlp", "time_mlp"),
        ("condition_embedding.mlp", "condition_mlp"),
        ("condition_embedding.null", "null"),
    ):
        name = name.replace(theirs, ours)
    return name


def _shape(weight: Tensor) -> list[int]:
    """Return a weight's shape without the height of its 2-D form."""
    return [*weight.shape[:2], weight.shape[3]] if weight.ndim == 4 else list(weight.shape)  # noqa: PLR2004


@torch.inference_mode()
def sample(unet: PaperUNet, manifest: Manifest, condition: Tensor, noise: Tensor) -> Tensor:
    """DDIM with 50 steps and guidance 2, two passes a step (paper, Sect. 3.4).

    Args:
        unet: the network.
        manifest: its noise schedule.
        condition: (4,), standardised [x_0, x*].
        noise: (K, H), standard normal.

    Returns:
        Controls (K, H), scaled to [-1, 1].
    """
    u = noise.unsqueeze(1)
    conditions = condition.expand(len(u), -1)
    for t, next_t in pairwise(even_times(len(manifest.alphas_cumprod), STEPS)):
        alpha = manifest.alphas_cumprod[t]
        next_alpha = 1.0 if next_t == CLEAN else manifest.alphas_cumprod[next_t]
        times = torch.full((len(u),), t)
        unconditional = unet(u, times, None)
        epsilon = unconditional + GUIDANCE_SCALE * (unet(u, times, conditions) - unconditional)
        clean = ((u - math.sqrt(1 - alpha) * epsilon) / math.sqrt(alpha)).clamp(-1, 1)
        epsilon = (u - math.sqrt(alpha) * clean) / math.sqrt(1 - alpha)
        u = math.sqrt(next_alpha) * clean + math.sqrt(1 - next_alpha) * epsilon
    return u.squeeze(1)
