"""The compiled kernel against the checkpoint that it was derived from."""

import io
from collections.abc import Callable, Iterator
from typing import TypeAlias

import pytest
import torch
from torch import Tensor, nn

from app.inference.networks.base import Network
from app.inference.networks.compiled import CompiledNetwork, UnsuitableNetwork, derive
from app.inference.networks.scripted import ScriptedNetwork
from app.inference.row_threads import RowThreads
from training.config import NetworkConfig
from training.export import to_torchscript
from training.unet import UNet

TIMES = 20
THREADS = RowThreads(1)

Change: TypeAlias = Callable[[UNet], object]


@pytest.fixture(autouse=True)
def no_gradients() -> Iterator[None]:
    with torch.no_grad():
        yield


def random_unet(channels: int = 16) -> UNet:
    """A network none of whose parameters has kept the value that it starts from."""
    torch.manual_seed(channels)
    unet = UNet(NetworkConfig(channels=channels, time_dimension=12, condition_dimension=20))
    for parameter in unet.parameters():
        parameter.add_(0.1 * torch.randn_like(parameter))
    return unet


def scripted(unet: nn.Module) -> torch.jit.ScriptModule:
    checkpoint = io.BytesIO(to_torchscript(unet))  # type: ignore[arg-type]
    script: torch.jit.ScriptModule = torch.jit.load(checkpoint)  # type: ignore[no-untyped-call]
    return script


def derived(unet: nn.Module, horizon: int = 16) -> CompiledNetwork:
    script = scripted(unet)
    return derive(script, ScriptedNetwork(script, THREADS), horizon, TIMES, THREADS)


def rows(network: Network, horizon: int = 64) -> tuple[Tensor, Tensor, Tensor]:
    """Controls, times and embeddings of 37 rows: four conditions, each of them also left out."""
    generator = torch.Generator().manual_seed(horizon)
    u_t = torch.randn(37, horizon, generator=generator)
    t = torch.randint(TIMES, (37,), generator=generator)
    embedding = torch.cat([network.embed(c) for c in torch.randn(4, 4, generator=generator)])
    return u_t, t, embedding[torch.randint(8, (37,), generator=generator)]


def predicted(network: Network, horizon: int = 64) -> Tensor:
    return network.predict(*rows(network, horizon))


@pytest.mark.parametrize("channels", [16, 32, 64, 80])
def test_it_predicts_what_the_checkpoint_does(channels: int) -> None:
    script = scripted(random_unet(channels))
    network = CompiledNetwork(script, TIMES, THREADS)

    for horizon in (8, 16, 24, 40, 64):
        expected = predicted(ScriptedNetwork(script, THREADS), horizon)

        assert expected.std() > 0.1
        torch.testing.assert_close(predicted(network, horizon), expected, rtol=0, atol=1e-4)


def test_a_row_is_the_same_to_the_last_bit_alone_and_in_company() -> None:
    network = CompiledNetwork(scripted(random_unet()), TIMES, THREADS)
    u_t, t, embedding = rows(network)
    together = network.predict(u_t, t, embedding)

    for row in range(37):
        part = slice(row, row + 1)
        assert torch.equal(network.predict(u_t[part], t[part], embedding[part]), together[part])


def test_rows_are_the_same_to_the_last_bit_on_any_number_of_threads() -> None:
    script = scripted(random_unet())
    expected = predicted(CompiledNetwork(script, TIMES, THREADS))

    for num_threads in (2, 3, 5):
        threads = RowThreads(num_threads)
        assert torch.equal(predicted(CompiledNetwork(script, TIMES, threads)), expected)
        threads.close()


def test_a_suitable_network_is_derived() -> None:
    unet = random_unet()

    for horizon in (8, 24, 64):
        torch.testing.assert_close(
            predicted(derived(unet, horizon), horizon),
            predicted(ScriptedNetwork(scripted(unet), THREADS), horizon),
            rtol=0,
            atol=1e-4,
        )


@pytest.mark.parametrize("horizon", [4, 20, 62])
def test_a_horizon_that_is_no_whole_number_of_tiles_is_refused(horizon: int) -> None:
    with pytest.raises(UnsuitableNetwork, match=f"horizon {horizon} is not a multiple of 8"):
        derived(random_unet(), horizon)


@pytest.mark.parametrize("channels", [8, 24])
def test_channels_that_do_not_fill_the_lanes_are_refused(channels: int) -> None:
    with pytest.raises(UnsuitableNetwork, match=f"{channels} channels, not a multiple of 16"):
        derived(random_unet(channels))


class OtherLayers(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv1d(1, 1, 3, padding=1)

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        noise: Tensor = self.layer(u)
        return noise


def test_other_layers_are_refused() -> None:
    with pytest.raises(UnsuitableNetwork, match="not those of Table 1"):
        derived(OtherLayers())


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
    ("change", "reason"),
    [
        (widen_block_kernels, "not those of Table 1"),
        (widen_one_kernel, "not those of Table 1"),
        (widen_input, "input_kernel is "),
        (narrow_downsampling, "downsampling_kernel is "),
        (narrow_upsampling, "not those of Table 1"),
        (leave_out_a_bias, "output.bias"),
        (narrow_an_embedding, "embeddings add to "),
    ],
)
def test_layers_of_other_sizes_are_refused(change: Change, reason: str) -> None:
    """Before the kernel, which checks no bounds, reads a single weight."""
    unet = random_unet()
    change(unet)
    assert torch.all(torch.isfinite(predicted(ScriptedNetwork(scripted(unet), THREADS))))

    with pytest.raises(UnsuitableNetwork, match=reason):
        derived(unet)


def activate_otherwise(unet: UNet) -> None:
    unet.decoder2.activation = nn.ReLU()  # type: ignore[assignment]


def group_otherwise(unet: UNet) -> None:
    unet.bottleneck1.norm2 = nn.GroupNorm(4, 16)


@pytest.mark.parametrize(
    "change", [activate_otherwise, group_otherwise], ids=lambda change: change.__name__
)
def test_the_same_sizes_that_compute_something_else_are_refused(change: Change) -> None:
    unet = random_unet()
    change(unet)

    with pytest.raises(UnsuitableNetwork, match="from its own"):
        derived(unet)


def test_a_network_that_gives_nan_is_refused() -> None:
    unet = random_unet()
    nn.init.constant_(unet.output.bias, torch.nan)  # type: ignore[arg-type]

    with pytest.raises(UnsuitableNetwork, match="nan from its own"):
        derived(unet)
