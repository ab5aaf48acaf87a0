"""The network by its compiled kernel: derived from the checkpoint, and checked against it."""

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import linear, pad, silu

from app.inference.kernel.convolution import GROUPS, KERNEL_TRANSFORM, POINTS
from app.inference.kernel.matrix_product import Floats
from app.inference.kernel.simd import LANES
from app.inference.kernel.unet import LENGTH_MULTIPLE, Weights, predict_rows
from app.inference.networks.base import CONDITION_SIZE, Network
from app.inference.row_threads import RowThreads

BLOCKS = ("encoder1", "encoder2", "bottleneck1", "bottleneck2", "decoder1", "decoder2")
TOLERANCE = 1e-4
CHECKED_TIMES = 8


class UnsuitableNetwork(ValueError):
    """The checkpoint's network is not one that the kernel can run."""


class CompiledNetwork:
    """The network of the paper's Table 1 on a CPU, its rows shared out over threads.

    What a diffusion time adds in the residual blocks depends on it alone and is computed here, for
    all T of them. An embedding (E = 6 C) is what a condition adds there.

    Args:
        unet: the checkpoint's network, in evaluation mode.
        num_timesteps: T.
        threads: share out the rows.

    Raises:
        UnsuitableNetwork: it has other layers than Table 1.
    """

    def __init__(
        self, unet: torch.jit.ScriptModule, num_timesteps: int, threads: RowThreads
    ) -> None:
        weights = unet.state_dict()
        self._threads = threads
        try:
            self._weights = _kernel_weights(weights)
            self._condition_embedding = unet.condition_embedding
            self._condition_weight = _stacked(weights, "condition_projection.weight")
            self._condition_bias = _stacked(weights, "condition_projection.bias")
            self._time_table = _floats(
                linear(
                    silu(unet.time_embedding(torch.arange(num_timesteps))),
                    _stacked(weights, "time_projection.weight"),
                    _stacked(weights, "time_projection.bias") + _stacked(weights, "conv1.bias"),
                )
            )
            added = {self._time_table.shape[1], self.embed(torch.zeros(CONDITION_SIZE)).shape[1]}
        except (AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
            raise UnsuitableNetwork(f"its layers are not those of Table 1 ({error})") from error
        _check_sizes(self._weights)
        if added != {self._weights.second_biases.size}:
            raise UnsuitableNetwork(f"its embeddings add to {added} channels")

    def embed(self, condition: Tensor) -> Tensor:
        """Return what the condition, and the null condition, add in the residual blocks."""
        with_and_without = torch.tensor([True, False])
        embedding = self._condition_embedding(condition.expand(2, -1), with_and_without)
        return linear(silu(embedding), self._condition_weight, self._condition_bias)

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        """Predict the noise, as `Network.predict`."""
        noise = torch.empty_like(u_t)
        controls, times, added, out = (x.numpy() for x in (u_t, t, embedding, noise))

        def work(rows: slice) -> None:
            predict_rows(
                self._weights, controls[rows], times[rows], self._time_table, added[rows], out[rows]
            )

        self._threads.share(len(u_t), work)
        return noise


def derive(
    unet: torch.jit.ScriptModule,
    reference: Network,
    horizon: int,
    num_timesteps: int,
    threads: RowThreads,
) -> CompiledNetwork:
    """Return `unet` by the compiled kernel, checked against `reference`, the checkpoint itself.

    Raises:
        UnsuitableNetwork: the kernel does not take its layers, sizes or horizon, or predicts
            something else.
    """
    if horizon % LENGTH_MULTIPLE:
        raise UnsuitableNetwork(f"its horizon {horizon} is not a multiple of {LENGTH_MULTIPLE}")
    network = CompiledNetwork(unet, num_timesteps, threads)
    generator = torch.Generator().manual_seed(0)
    condition = torch.randn(CONDITION_SIZE, generator=generator)
    # With and without the condition at each of some times.
    t = torch.linspace(0, num_timesteps - 1, CHECKED_TIMES).long().repeat_interleave(2)
    u_t = torch.randn(len(t), horizon, generator=generator)
    ours, theirs = (
        n.predict(u_t, t, n.embed(condition).repeat(CHECKED_TIMES, 1)) for n in (network, reference)
    )
    difference = float((ours - theirs).abs().max())
    # Not ">": a NaN on either side is no agreement.
    if not difference <= TOLERANCE:
        raise UnsuitableNetwork(f"the kernel's predictions are {difference:.0e} from its own")
    return network


def _stacked(weights: dict[str, Tensor], name: str) -> Tensor:
    """Return that parameter of all residual blocks, one below the other."""
    return torch.cat([weights[f"{block}.{name}"] for block in BLOCKS])


def _kernel_weights(weights: dict[str, Tensor]) -> Weights:
    """Arrange the weights as the kernel reads them.

    Raises:
        LookupError, RuntimeError: these are not Table 1's layers.
    """

    def taps_first(name: str) -> Tensor:
        """Return a convolution's (out, in, 1, taps) as (taps in, out)."""
        return weights[f"{name}.weight"].squeeze(2).permute(2, 1, 0).flatten(0, 1)

    def both(name: str) -> Tensor:
        """Return a parameter of the first and second half of every block, in order: (12, ...)."""
        return torch.stack(
            [weights[f"{block}.{name.format(half)}"] for block in BLOCKS for half in (1, 2)]
        )

    transform = torch.from_numpy(KERNEL_TRANSFORM)
    taps = both("conv{}.weight").squeeze(3).double()
    upsampling = weights["upsampling.weight"].squeeze(2).permute(2, 0, 1)
    return Weights(
        input_kernel=_floats(taps_first("input").flatten()),
        input_bias=_floats(weights["input.bias"]),
        norm_scales=_floats(both("norm{}.weight")),
        norm_shifts=_floats(both("norm{}.bias")),
        block_kernels=_floats(torch.einsum("pt,noit->npio", transform, taps).flatten(1)),
        second_biases=_floats(_stacked(weights, "conv2.bias").view(len(BLOCKS), -1)),
        downsampling_kernel=_floats(taps_first("downsampling").flatten()),
        downsampling_bias=_floats(weights["downsampling.bias"]),
        upsampling_even_kernel=_floats(torch.cat([upsampling[3], upsampling[1]]).flatten()),
        upsampling_odd_kernel=_floats(torch.cat([upsampling[2], upsampling[0]]).flatten()),
        upsampling_bias=_floats(weights["upsampling.bias"]),
        output_kernel=_floats(pad(taps_first("output"), (0, LANES - 1)).flatten()),
        output_bias=_floats(weights["output.bias"]),
    )


def _check_sizes(weights: Weights) -> None:
    """Compare every size with what the kernel, which checks no bounds, will read.

    Raises:
        UnsuitableNetwork: a size is another one.
    """
    channels, blocks = weights.input_bias.size, len(BLOCKS)
    if channels % LANES or channels % GROUPS:
        raise UnsuitableNetwork(f"it has {channels} channels, not a multiple of {LANES}")
    square = channels * channels
    expected: dict[str, tuple[int, ...]] = {
        "input_kernel": (3 * channels,),
        "input_bias": (channels,),
        "norm_scales": (2 * blocks, channels),
        "norm_shifts": (2 * blocks, channels),
        "block_kernels": (2 * blocks, POINTS * square),
        "second_biases": (blocks, channels),
        "downsampling_kernel": (4 * square,),
        "downsampling_bias": (channels,),
        "upsampling_even_kernel": (2 * square,),
        "upsampling_odd_kernel": (2 * square,),
        "upsampling_bias": (channels,),
        "output_kernel": (3 * channels * LANES,),
        "output_bias": (1,),
    }
    for name, shape in expected.items():
        found = getattr(weights, name).shape
        if found != shape:
            raise UnsuitableNetwork(f"{name} is {found}, not {shape}")


def _floats(tensor: Tensor) -> Floats:
    return np.ascontiguousarray(tensor.detach().numpy(), dtype=np.float32)
