"""The networks that can be trained, by the configuration's section `network`."""

from typing import TypeAlias

from training.config import MLPConfig, UNetConfig
from training.mlp import MLP
from training.unet import UNet

Denoiser: TypeAlias = UNet | MLP


def build_network(config: UNetConfig | MLPConfig, condition_size: int, horizon: int) -> Denoiser:
    """Return a network with random weights for conditions (C,) and controls (H,)."""
    if isinstance(config, MLPConfig):
        return MLP(config, condition_size, horizon)
    return UNet(config, condition_size)
