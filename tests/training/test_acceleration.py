"""When a step is compiled, and that compiling changes its speed and not what it computes."""

import logging
import shutil

import pytest
import torch
from llvmlite import binding

from training.acceleration import CPU_FEATURES, MINIMUM_STEPS, accelerated
from training.config import UNetConfig
from training.unet import UNet

CPU = torch.device("cpu")


@pytest.fixture
def unet() -> UNet:
    torch.manual_seed(0)
    return UNet(UNetConfig(kind="unet", channels=16, time_dimension=16, condition_dimension=16), 4)


@pytest.fixture
def capable(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that has everything."""
    monkeypatch.setenv("CXX", "true")
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: {"avx512bf16": True})


@pytest.mark.usefixtures("capable")
def test_a_long_training_is_compiled_where_it_can_be(unet: UNet) -> None:
    assert accelerated(unet, CPU, MINIMUM_STEPS) is not unet


@pytest.mark.usefixtures("capable")
def test_a_short_training_is_not_compiled(unet: UNet, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    assert accelerated(unet, CPU, MINIMUM_STEPS - 1) is unet
    assert "compiling" in caplog.text


@pytest.mark.usefixtures("capable")
def test_without_a_compiler_training_is_plain_and_says_so(
    unet: UNet, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    monkeypatch.setenv("CXX", "no-such-compiler")

    assert accelerated(unet, CPU, MINIMUM_STEPS) is unet
    assert "no C++ compiler no-such-compiler" in caplog.text


@pytest.mark.usefixtures("capable")
def test_without_bfloat16_in_the_processor_training_is_plain(
    unet: UNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: {"avx2": True})

    assert accelerated(unet, CPU, MINIMUM_STEPS) is unet


@pytest.mark.slow
def test_compiled_predictions_and_gradients_are_those_of_the_network(unet: UNet) -> None:
    features = binding.get_host_cpu_features()
    if shutil.which("g++") is None or not any(features.get(name) for name in CPU_FEATURES):
        pytest.skip("needs g++ and a processor that multiplies bfloat16")
    arguments = (
        torch.randn(32, 1, 64),
        torch.arange(32),
        torch.randn(32, 4),
        torch.arange(32) % 2 == 0,
    )
    results = []
    for network in (unet, accelerated(unet, CPU, MINIMUM_STEPS)):
        unet.zero_grad()
        noise = network(*arguments)
        noise.square().mean().backward()
        assert noise.dtype == torch.float32
        gradients = torch.cat([p.grad.flatten() for p in unet.parameters() if p.grad is not None])
        results.append((noise.detach(), gradients.clone()))

    (noise, gradients), (compiled_noise, compiled_gradients) = results
    # bfloat16 has eight bits: a percent or so after a dozen layers.
    assert (compiled_noise - noise).norm() < 0.03 * noise.norm()
    assert (compiled_gradients - gradients).norm() < 0.05 * gradients.norm()
    assert (compiled_noise - noise).norm() > 0
