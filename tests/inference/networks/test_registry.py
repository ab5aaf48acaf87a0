"""Which network runs a checkpoint: the fastest one that suits it and agrees with it."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeAlias

import pytest
import torch
from torch import nn

from app.inference.networks import build_network
from app.inference.networks.base import Checkpoint, Network
from app.inference.networks.compiled import CompiledNetwork
from app.inference.networks.scripted import ScriptedNetwork
from app.inference.row_threads import RowThreads
from tests.inference.networks.conftest import RandomUNet, Read
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


def test_a_condition_of_another_size_than_the_checkpoint_takes_is_no_network(
    random_unet: RandomUNet, read: Read
) -> None:
    checkpoint = read(random_unet())

    with pytest.raises(RuntimeError):
        built(replace(checkpoint, condition_size=checkpoint.condition_size + 1))
