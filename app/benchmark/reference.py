"""The references: what plain PyTorch makes of the paper's network, its sampler, and a product.

Nothing else in the benchmark knows PyTorch.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor
from torch.nn.functional import conv1d, conv_transpose1d, group_norm, linear, silu
from torch.utils.flop_counter import FlopCounterMode

from app.benchmark.pairing import median_ms
from app.inference.checkpoint import GROUPS
from app.inference.device import CPU
from app.inference.diffusion_times import CLEAN
from app.inference.manifest import Manifest
from app.inference.torchscript import freeze, read_torchscript
from app.planning.arrays import FloatArray
from app.planning.methods.sampler import PAPER_SAMPLER
from app.planning.plant.natural_units import natural_units
from app.planning.problem import Problem


class PaperNetwork:
    """The conditional 1D U-Net (paper, Table 1) in eager PyTorch, with a checkpoint's weights.

    Args:
        weights: by their names in the checkpoint, whose convolutions are in 2-D form.
    """

    def __init__(self, weights: dict[str, Tensor]) -> None:
        self._weights = {
            name: weight.flatten(2) if weight.ndim > 2 else weight  # noqa: PLR2004
            for name, weight in weights.items()
        }

    def __call__(self, u_t: Tensor, t: Tensor, condition: Tensor | None) -> Tensor:
        """Predict the noise (B, 1, H) in `u_t` (B, 1, H); `condition` (B, C), or None."""
        angles = t.float().unsqueeze(1) * self._weights["time_embedding.frequencies"]
        time = self._mlp("time_embedding", torch.cat([angles.sin(), angles.cos()], dim=1))
        states = (
            self._weights["condition_embedding.null"].expand(len(t), -1)
            if condition is None
            else self._mlp("condition_embedding", condition)
        )
        x = conv1d(u_t, *self._layer("input"), padding=1)
        x = self._block("encoder1", x, time, states)
        skip = self._block("encoder2", x, time, states)
        x = conv1d(skip, *self._layer("downsampling"), stride=2, padding=1)
        x = self._block("bottleneck1", x, time, states)
        x = self._block("bottleneck2", x, time, states)
        x = conv_transpose1d(x, *self._layer("upsampling"), stride=2, padding=1) + skip
        x = self._block("decoder1", x, time, states)
        x = self._block("decoder2", x, time, states)
        return conv1d(x, *self._layer("output"), padding=1)

    def _block(self, block: str, x: Tensor, time: Tensor, states: Tensor) -> Tensor:
        """Return a residual block's output: the embeddings are added between two convolutions."""
        h = self._activated_convolution(block, 1, x)
        h = h + linear(silu(time), *self._layer(f"{block}.time_projection")).unsqueeze(2)
        h = h + linear(silu(states), *self._layer(f"{block}.condition_projection")).unsqueeze(2)
        return x + self._activated_convolution(block, 2, h)

    def _activated_convolution(self, block: str, half: int, x: Tensor) -> Tensor:
        activated = silu(group_norm(x, GROUPS, *self._layer(f"{block}.norm{half}")))
        return conv1d(activated, *self._layer(f"{block}.conv{half}"), padding=1)

    def _mlp(self, name: str, x: Tensor) -> Tensor:
        return linear(silu(linear(x, *self._layer(f"{name}.mlp.0"))), *self._layer(f"{name}.mlp.2"))

    def _layer(self, name: str) -> tuple[Tensor, Tensor]:
        return self._weights[f"{name}.weight"], self._weights[f"{name}.bias"]


class Reference:
    """A checkpoint as plain PyTorch runs it, eagerly and as TorchScript.

    Args:
        checkpoint: the file's bytes.
        manifest: of the checkpoint.
    """

    def __init__(self, checkpoint: bytes, manifest: Manifest) -> None:
        script = read_torchscript(checkpoint, CPU)
        self._manifest = manifest
        self._network = PaperNetwork(script.state_dict())
        self._frozen = freeze(script)

    @torch.inference_mode()
    def sample(self, problem: Problem, noise: FloatArray) -> FloatArray:
        """Sample by DDIM with 50 steps and guidance 2, two passes a step (paper, Sect. 3.4).

        Args:
            problem: start and target.
            noise: (K, H), standard normal.

        Returns:
            Controls (K, H), units of control.
        """
        alphas_cumprod = self._manifest.alphas_cumprod
        u = torch.tensor(noise, dtype=torch.float32).unsqueeze(1)
        condition = torch.from_numpy(self._manifest.encode(problem)).expand(len(u), -1)
        for t, next_t in pairwise(self._manifest.times(PAPER_SAMPLER.settings)):
            alpha = alphas_cumprod[t]
            next_alpha = 1.0 if next_t == CLEAN else alphas_cumprod[next_t]
            times = torch.full((len(u),), t)
            without = self._network(u, times, None)
            epsilon = without + PAPER_SAMPLER.settings.guidance_scale * (
                self._network(u, times, condition) - without
            )
            clean = ((u - math.sqrt(1 - alpha) * epsilon) / math.sqrt(alpha)).clamp(-1, 1)
            epsilon = (u - math.sqrt(alpha) * clean) / math.sqrt(1 - alpha)
            u = math.sqrt(next_alpha) * clean + math.sqrt(1 - next_alpha) * epsilon
        middle, half, *_ = natural_units(problem.system.plant)
        controls: FloatArray = middle + half * u.squeeze(1).double().numpy()
        return controls

    def operations_of_a_row(self) -> int:
        """Count the floating-point operations of a row as the layers define them."""
        with FlopCounterMode(display=False) as counter:
            self._network(*self._arguments(1))
        return int(counter.get_total_flops())

    def forward_passes(self, rows: int) -> tuple[Callable[[], object], Callable[[], object]]:
        """Return a forward pass of so many rows by eager PyTorch, and by TorchScript."""
        u_t, t, condition = self._arguments(rows)
        keep = torch.ones(rows, dtype=torch.bool)
        eager = torch.inference_mode()(lambda: self._network(u_t, t, condition))
        scripted = torch.inference_mode()(lambda: self._frozen(u_t, t, condition, keep))
        return eager, scripted

    def _arguments(self, rows: int) -> tuple[Tensor, Tensor, Tensor]:
        return (
            torch.randn(rows, 1, self._manifest.horizon),
            torch.randint(len(self._manifest.alphas_cumprod), (rows,)),
            torch.randn(rows, self._manifest.condition.size),
        )


def use_threads(num_threads: int) -> None:
    """Give PyTorch, which the engine keeps to one, so many threads in this one."""
    torch.set_num_threads(num_threads)


def gigaflops_of_product(size: int) -> float:
    """Return the GFLOP/s of PyTorch's own product of two matrices (size, size)."""
    a = torch.randn(size, size)
    return float(2 * size**3 / median_ms(lambda: a @ a) / 1e6)
