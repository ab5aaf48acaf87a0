"""Which checkpoints the compiled kernel takes, before it reads a single weight."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeAlias

import pytest
import torch
from torch import Tensor, nn

from app.inference.networks.base import AnotherNetwork, UnsuitableNetwork
from app.inference.networks.compiled import CompiledNetwork
from app.inference.networks.scripted import run_script
from app.inference.row_threads import RowThreads
from tests.inference.networks.conftest import CONDITION_SIZE, RandomUNet, Read
from training.unet import ConditionEmbedding, UNet

THREADS = RowThreads(1)

Change: TypeAlias = Callable[[UNet], object]


@pytest.fixture(autouse=True)
def no_gradients() -> Iterator[None]:
    with torch.no_grad():
        yield


@pytest.mark.parametrize("horizon", [4, 20, 62])
def test_a_horizon_that_is_no_whole_number_of_tiles_is_refused(
    horizon: int, random_unet: RandomUNet, read: Read
) -> None:
    with pytest.raises(UnsuitableNetwork, match=f"horizon {horizon} is not a multiple of 8"):
        CompiledNetwork(read(random_unet(), horizon), THREADS)


@pytest.mark.parametrize("channels", [8, 24])
def test_channels_that_do_not_fill_the_lanes_are_refused(
    channels: int, random_unet: RandomUNet, read: Read
) -> None:
    with pytest.raises(UnsuitableNetwork, match=f"{channels} channels, not a multiple of 16"):
        CompiledNetwork(read(random_unet(channels)), THREADS)


def test_a_gpu_is_not_for_the_kernel(random_unet: RandomUNet, read: Read) -> None:
    checkpoint = replace(read(random_unet()), device=torch.device("cuda"))

    with pytest.raises(UnsuitableNetwork, match="for CPUs"):
        CompiledNetwork(checkpoint, THREADS)


class OtherLayers(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv1d(1, 1, 3, padding=1)

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        noise: Tensor = self.layer(u)
        return noise


def test_a_network_of_another_make_is_refused_as_such(read: Read) -> None:
    with pytest.raises(AnotherNetwork, match="another network than the U-Net"):
        CompiledNetwork(read(OtherLayers()), THREADS)


def widen_block_kernels(unet: UNet) -> None:
    for module in (m for name, m in unet.named_children() if "coder" in name or "neck" in name):
        module.conv1, module.conv2 = (nn.Conv2d(16, 16, (1, 5), padding=(0, 2)) for _ in range(2))


def widen_one_kernel(unet: UNet) -> None:
    unet.encoder2.conv1 = nn.Conv2d(16, 16, (1, 5), padding=(0, 2))


def widen_input(unet: UNet) -> None:
    unet.input = nn.Conv2d(1, 16, (1, 5), padding=(0, 2))


def narrow_downsampling(unet: UNet) -> None:
    unet.downsampling = nn.Conv2d(16, 16, (1, 2), stride=(1, 2))


def narrow_upsampling(unet: UNet) -> None:
    unet.upsampling = nn.ConvTranspose2d(16, 16, (1, 2), stride=(1, 2))


def leave_out_a_bias(unet: UNet) -> None:
    unet.output = nn.Conv2d(16, 1, (1, 3), padding=(0, 1), bias=False)


def narrow_an_embedding(unet: UNet) -> None:
    """Add one number to all channels."""
    unet.bottleneck1.condition_projection = nn.Linear(20, 1)


@pytest.mark.parametrize(
    ("change", "parameter"),
    [
        (widen_block_kernels, "encoder1.conv1.weight"),
        (widen_one_kernel, "encoder2.conv1.weight"),
        (widen_input, "input.weight"),
        (narrow_downsampling, "downsampling.weight"),
        (narrow_upsampling, "upsampling.weight"),
        (leave_out_a_bias, "output.bias"),
        (narrow_an_embedding, "bottleneck1.condition_projection.weight"),
    ],
)
def test_layers_of_other_sizes_are_refused(
    change: Change, parameter: str, random_unet: RandomUNet, read: Read
) -> None:
    """Before the kernel, which checks no bounds, reads a single weight."""
    unet = random_unet()
    change(unet)
    checkpoint = read(unet, horizon=16)
    noise = run_script(
        checkpoint.script,
        torch.zeros(2, 16),
        torch.zeros(2, dtype=torch.int64),
        torch.zeros(2, CONDITION_SIZE),
        torch.tensor([True, False]),
    )
    assert torch.all(torch.isfinite(noise))

    with pytest.raises(UnsuitableNetwork, match=f"not those of Table 1: {parameter} is"):
        CompiledNetwork(checkpoint, THREADS)


class Repeated(nn.Module):
    """A condition embedding with the same parameters, that embeds every row twice."""

    def __init__(self, embedding: ConditionEmbedding) -> None:
        super().__init__()
        self.mlp = embedding.mlp
        self.null = embedding.null

    def forward(self, condition: Tensor, keep_condition: Tensor) -> Tensor:
        embedding: Tensor = torch.where(keep_condition.unsqueeze(1), self.mlp(condition), self.null)
        return embedding.repeat(2, 1)


def test_embeddings_of_another_shape_are_refused(random_unet: RandomUNet, read: Read) -> None:
    unet = random_unet()
    unet.condition_embedding = Repeated(unet.condition_embedding)  # type: ignore[assignment]

    with pytest.raises(UnsuitableNetwork, match="embeddings do not add to every channel"):
        CompiledNetwork(read(unet), THREADS)
