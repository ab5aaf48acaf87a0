import warnings

import pytest
import torch
from torch import Tensor, nn

from app.inference.device import CPU
from app.inference.torchscript import freeze, read_torchscript, to_torchscript


class Doubles(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.factor = nn.Parameter(torch.tensor(2.0))

    def forward(self, x: Tensor) -> Tensor:
        return x if self.training else self.factor * x


def test_a_network_is_written_read_and_frozen_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        script = read_torchscript(to_torchscript(Doubles()), CPU)
        frozen = freeze(script)

    for network in (script, frozen):
        assert float(network(torch.tensor(3.0))) == 6.0


def test_what_is_read_is_there_to_be_run_and_not_to_be_trained() -> None:
    script = read_torchscript(to_torchscript(Doubles()), CPU)

    assert not script.training
    assert not script(torch.tensor(3.0)).requires_grad


def test_other_bytes_are_refused() -> None:
    with pytest.raises(RuntimeError):
        read_torchscript(b"not a model", CPU)
