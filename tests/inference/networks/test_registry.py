"""Which network runs a checkpoint: the fastest one that suits it and agrees with it."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeAlias

import pytest
import torch
from torch import Tensor, nn

from app.inference.networks import build_network
from app.inference.networks.base import Checkpoint, Network
from app.inference.networks.compiled import CompiledNetwork
from app.inference.networks.scripted import ScriptedNetwork
from app.inference.row_threads import RowThreads
from tests.inference.networks.conftest import CONDITION_SIZE, RandomUNet, Read
from training.unet import UNet

THREADS = RowThreads(1)

Change: TypeAlias = Callable[[UNet], object]


@pytest.fixture(autouse=True)
def no_gradients() -> Iterator[None]:
    with torch.no_grad():
        yield


def built(checkpoint: Checkpoint) -> Network:
    return build_network(checkpoint, THREADS, "some-model")


@pytest.mark.parametrize("horizon", [8, 24, 64])
def test_a_suitable_checkpoint_is_run_by_the_kernel_without_a_word(
    horizon: int, random_unet: RandomUNet, read: Read, caplog: pytest.LogCaptureFixture
) -> None:
    assert isinstance(built(read(random_unet(), horizon)), CompiledNetwork)
    assert not caplog.records


def activate_otherwise(unet: UNet) -> None:
    unet.decoder2.activation = nn.ReLU()  # type: ignore[assignment]


def group_otherwise(unet: UNet) -> None:
    unet.bottleneck1.norm2 = nn.GroupNorm(4, 16)


@pytest.mark.parametrize(
    "change", [activate_otherwise, group_otherwise], ids=lambda change: change.__name__
)
def test_the_same_sizes_that_compute_something_else_run_as_they_are(
    change: Change, random_unet: RandomUNet, read: Read, caplog: pytest.LogCaptureFixture
) -> None:
    unet = random_unet()
    change(unet)

    assert isinstance(built(read(unet)), ScriptedNetwork)
    (record,) = caplog.records
    assert "some-model runs as TorchScript" in record.getMessage()
    assert "from the checkpoint's" in record.getMessage()


def test_a_network_that_gives_nan_runs_as_it_is(
    random_unet: RandomUNet, read: Read, caplog: pytest.LogCaptureFixture
) -> None:
    unet = random_unet()
    nn.init.constant_(unet.output.bias, torch.nan)  # type: ignore[arg-type]

    assert isinstance(built(read(unet)), ScriptedNetwork)
    assert "predictions are nan from the checkpoint's" in caplog.text


def test_an_unsuitable_checkpoint_runs_as_it_is_and_the_log_says_why(
    random_unet: RandomUNet, read: Read, caplog: pytest.LogCaptureFixture
) -> None:
    assert isinstance(built(read(random_unet(), horizon=20)), ScriptedNetwork)
    assert "slowly: its horizon 20 is not a multiple of 8" in caplog.text


class MLP(nn.Module):
    """A network with the U-Net's arguments, and another inside."""

    def __init__(self, horizon: int) -> None:
        super().__init__()
        self.input = nn.Linear(horizon + 1 + CONDITION_SIZE, 32)
        self.output = nn.Linear(32, horizon)

    def forward(self, u_t: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:
        known = condition * keep.unsqueeze(1).to(condition.dtype)
        x = torch.cat([u_t[:, 0], t.unsqueeze(1).to(u_t.dtype) / 20.0, known], dim=1)
        out: Tensor = self.output(torch.relu(self.input(x)))
        return out.unsqueeze(1)


@pytest.mark.parametrize("horizon", [20, 64])
def test_a_network_that_is_no_unet_runs_as_it_is_and_nothing_is_said_to_be_wrong(
    horizon: int, read: Read, caplog: pytest.LogCaptureFixture
) -> None:
    torch.manual_seed(0)
    mlp = MLP(horizon)
    caplog.set_level(logging.DEBUG)
    network = built(read(mlp, horizon))

    assert isinstance(network, ScriptedNetwork)
    assert [record.levelno for record in caplog.records] == [logging.DEBUG]
    assert "another network than the U-Net" in caplog.text
    u_t, t = torch.randn(5, horizon), torch.arange(5)
    condition, keep = torch.randn(CONDITION_SIZE), torch.tensor([True, False, True, True, False])
    embedding = network.embed(condition)[(~keep).long()]
    torch.testing.assert_close(
        network.predict(u_t, t, embedding),
        mlp(u_t.unsqueeze(1), t, condition.expand(5, -1), keep)[:, 0],
    )


def test_a_condition_of_another_size_than_the_checkpoint_takes_is_no_network(
    random_unet: RandomUNet, read: Read
) -> None:
    checkpoint = read(random_unet())

    with pytest.raises(RuntimeError):
        built(replace(checkpoint, condition_size=checkpoint.condition_size + 1))
