"""A step in half the time: fused by PyTorch's compiler, its products in bfloat16.

The weights, their averages, the loss and the optimiser stay float32.
"""

import logging
import os
import shutil
from collections.abc import Callable

import torch
from llvmlite import binding
from torch import Tensor, nn

MINIMUM_STEPS = 2000
"""Compiling takes about 40 s on two cores: as long as it saves in so many steps."""
CPU_FEATURES = ("avx512bf16", "amx-bf16", "bf16")
"""LLVM's names of instructions that multiply bfloat16; without them it is slower than float32."""

log = logging.getLogger("training")


def accelerated(network: nn.Module, device: torch.device, steps: int) -> Callable[..., Tensor]:
    """Return `network` as a training of `steps` steps computes it: faster if it can be and pays."""
    obstacle = _obstacle(device, steps)
    if obstacle:
        log.info("training in float32, step by step: %s", obstacle)
        return network
    log.info("training compiled, in bfloat16")
    compiled = torch.compile(network)

    def forward(*arguments: Tensor) -> Tensor:
        with torch.autocast(device.type, torch.bfloat16):
            predicted: Tensor = compiled(*arguments)
        return predicted.float()

    return forward


def _obstacle(device: torch.device, steps: int) -> str | None:
    """Return why not to compile, if there is a reason."""
    if steps < MINIMUM_STEPS:
        return f"fewer than {MINIMUM_STEPS} steps do not make up for compiling"
    if device.type != "cpu":
        return None
    compiler = os.environ.get("CXX", "g++")
    if shutil.which(compiler) is None:
        return f"there is no C++ compiler {compiler}"
    features = binding.get_host_cpu_features()
    if not any(features.get(name) for name in CPU_FEATURES):
        return "the processor does not multiply bfloat16"
    return None
