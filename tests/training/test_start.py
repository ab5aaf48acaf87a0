"""A training that goes on from the weights of a shipped model."""

from pathlib import Path

import pytest
import torch

from app.inference.device import CPU
from app.inference.torchscript import read_torchscript
from app.inference.verification import verify
from training.config import TrainingConfig
from training.network import build_network
from training.start import SHIPPED, StartingPoint

CONFIG = TrainingConfig.read(Path("training/any-machine-robust.toml"))


def test_what_the_model_was_not_told_weighs_nothing_at_first() -> None:
    start = StartingPoint.of("any-machine/1")
    size = len(start.conditioning.features)
    network = build_network(CONFIG.network, size + 4, 64)
    start.fill(network)
    script = read_torchscript(verify(SHIPPED / "any-machine" / "1")[1], CPU)
    draws = torch.Generator().manual_seed(0)
    u, condition = torch.randn(3, 1, 64, generator=draws), torch.randn(3, size, generator=draws)
    more = torch.randn(3, 4, generator=draws)
    t, keep = torch.tensor([0, 70, 199]), torch.tensor([True, True, False])

    with torch.no_grad():
        predicted = network(u, t, torch.cat([condition, more], dim=1), keep)
        torch.testing.assert_close(predicted, script(u, t, condition, keep), atol=1e-5, rtol=0)


def test_a_model_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot start from any-machine/99"):
        StartingPoint.of("any-machine/99")


def test_other_layers_are_refused() -> None:
    start = StartingPoint.of("dry-friction-fs0.7/1")

    with pytest.raises(ValueError, match="has other layers"):
        start.fill(build_network(CONFIG.network, 8, 64))
