"""A checkpoint of random weights, as the networks are given it."""

from collections.abc import Callable, Iterator
from typing import TypeAlias

import pytest
import torch
from torch import nn

from app.inference.device import CPU
from app.inference.networks.base import Checkpoint
from app.inference.row_threads import RowThreads
from app.inference.torchscript import read_torchscript, to_torchscript
from training.config import UNetConfig
from training.unet import UNet

TIMES = 20
CONDITION_SIZE = 5
"""Not the paper's: none of the networks may count on it."""

RandomUNet: TypeAlias = Callable[..., UNet]
"""random_unet(channels): none of its parameters has the value that it starts training from."""
Read: TypeAlias = Callable[..., Checkpoint]
"""read(network, horizon): the checkpoint that it is written to and read from again."""


@pytest.fixture(scope="session")
def random_unet() -> RandomUNet:
    @torch.no_grad()
    def random_unet(channels: int = 16) -> UNet:
        torch.manual_seed(channels)
        config = UNetConfig(
            kind="unet", channels=channels, time_dimension=12, condition_dimension=20
        )
        unet = UNet(config, CONDITION_SIZE)
        for parameter in unet.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
        return unet

    return random_unet


@pytest.fixture(scope="session")
def read() -> Read:
    def read(network: nn.Module, horizon: int = 64) -> Checkpoint:
        script = read_torchscript(to_torchscript(network), CPU)
        return Checkpoint(script, CPU, horizon, TIMES, CONDITION_SIZE)

    return read


@pytest.fixture(params=[1, 2, 3], ids=lambda n: f"{n} threads")
def threads(request: pytest.FixtureRequest) -> Iterator[RowThreads]:
    threads = RowThreads(request.param)
    yield threads
    threads.close()
