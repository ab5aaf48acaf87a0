"""The network by its compiled kernel, derived from the checkpoint's weights."""

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import linear, silu

from app.inference.checkpoint import BLOCKS, GROUPS, LayoutMismatch, read_widths
from app.inference.kernel import LANES, LENGTH_MULTIPLE, Floats, arrange, predict_rows
from app.inference.networks.base import AnotherNetwork, Checkpoint, UnsuitableNetwork
from app.inference.row_threads import RowThreads


class CompiledNetwork:
    """The network of the paper's Table 1 on a CPU, its rows shared out over threads.

    What a diffusion time adds in the residual blocks depends on it alone and is computed here, for
    all T of them. An embedding (E = 6 channels) is what a condition adds there.

    Args:
        checkpoint: whose network this is.
        threads: share out the rows.

    Raises:
        UnsuitableNetwork: the kernel does not take its layers, sizes or horizon.
        AnotherNetwork: it is no U-Net.
    """

    def __init__(self, checkpoint: Checkpoint, threads: RowThreads) -> None:
        if checkpoint.device.type != "cpu":
            raise UnsuitableNetwork("the kernel is for CPUs")
        unet, parameters = checkpoint.script, checkpoint.script.state_dict()
        if not any(name.startswith(BLOCKS) for name in parameters):
            raise AnotherNetwork("it is another network than the U-Net, which alone is compiled")
        if checkpoint.horizon % LENGTH_MULTIPLE:
            raise UnsuitableNetwork(
                f"its horizon {checkpoint.horizon} is not a multiple of {LENGTH_MULTIPLE}"
            )
        channels = _channels(parameters)
        self._threads = threads
        self._weights = arrange({name: _floats(tensor) for name, tensor in parameters.items()})
        self._condition_weight = _stacked(parameters, "condition_projection.weight")
        self._condition_bias = _stacked(parameters, "condition_projection.bias")
        times = torch.arange(checkpoint.num_timesteps)
        try:
            self._condition_embedding = unet.condition_embedding
            self._time_table = _floats(
                linear(
                    silu(unet.time_embedding(times)),
                    _stacked(parameters, "time_projection.weight"),
                    _stacked(parameters, "time_projection.bias")
                    + _stacked(parameters, "conv1.bias"),
                )
            )
            embedding = self.embed(torch.zeros(checkpoint.condition_size))
        except (AttributeError, RuntimeError, TypeError) as error:
            raise UnsuitableNetwork(f"its layers are not those of Table 1 ({error})") from error
        # The kernel checks no bounds, and these two come from the checkpoint's own code.
        added = len(BLOCKS) * channels
        if self._time_table.shape != (len(times), added) or embedding.shape != (2, added):
            raise UnsuitableNetwork("its embeddings do not add to every channel of every block")

    def embed(self, condition: Tensor) -> Tensor:
        """Return what the condition, and the null condition, add in the residual blocks."""
        with_and_without = torch.tensor([True, False])
        embedding = self._condition_embedding(condition.expand(2, -1), with_and_without)
        return linear(silu(embedding), self._condition_weight, self._condition_bias)

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        """Predict as `Network.predict`."""
        prediction = torch.empty_like(u_t)
        controls, times, added, out = (x.numpy() for x in (u_t, t, embedding, prediction))

        def work(rows: slice) -> None:
            predict_rows(
                self._weights, controls[rows], times[rows], self._time_table, added[rows], out[rows]
            )

        self._threads.share(len(u_t), work)
        return prediction


def _channels(parameters: dict[str, Tensor]) -> int:
    """Return the number of channels.

    Raises:
        UnsuitableNetwork: the parameters are not those that the kernel, which checks no bounds,
            will read.
    """
    try:
        widths = read_widths({name: tuple(tensor.shape) for name, tensor in parameters.items()})
    except LayoutMismatch as error:
        raise UnsuitableNetwork(str(error)) from error
    channels = widths.channels
    if channels % LANES or channels % GROUPS:
        raise UnsuitableNetwork(f"it has {channels} channels, not a multiple of {LANES}")
    return channels


def _stacked(parameters: dict[str, Tensor], name: str) -> Tensor:
    """Return that parameter of all residual blocks, one below the other."""
    return torch.cat([parameters[f"{block}.{name}"] for block in BLOCKS])


def _floats(tensor: Tensor) -> Floats:
    return np.ascontiguousarray(tensor.detach().numpy(), dtype=np.float32)
