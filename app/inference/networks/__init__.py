"""What can run a checkpoint's network: a registry, the fastest kind first.

A new kind is a file beside this one and an entry in `KINDS`; the contract test runs over all.
"""

import logging
from collections.abc import Callable, Sequence
from typing import TypeAlias

import torch

from app.inference.networks.base import AnotherNetwork, Checkpoint, Network, UnsuitableNetwork
from app.inference.networks.compiled import CompiledNetwork
from app.inference.networks.scripted import ScriptedNetwork, run_script
from app.inference.row_threads import RowThreads

Kind: TypeAlias = Callable[[Checkpoint, RowThreads], Network]
"""Builds a network; raises `UnsuitableNetwork` if it cannot run the checkpoint."""

KINDS: tuple[Kind, ...] = (CompiledNetwork, ScriptedNetwork)
"""From the fastest to the slowest; the last one is the checkpoint itself and takes every one."""
TOLERANCE = 1e-4
"""How far what a network predicts may be from the checkpoint's."""
CHECKED_TIMES = 8
WARM_UP_CALLS = 3
"""After so many, TorchScript's executor has profiled, optimised and settled."""

log = logging.getLogger(__name__)


@torch.inference_mode()
def build_network(
    checkpoint: Checkpoint, threads: RowThreads, name: str, kinds: Sequence[Kind] = KINDS
) -> Network:
    """Return the fastest network that suits the checkpoint and agrees with it, warmed up.

    A network that is no U-Net, an MLP say, runs as TorchScript, as it is meant to.

    Args:
        checkpoint: to run.
        threads: share out the rows on a CPU.
        name: of the model, for the log.
        kinds: to choose from, the fastest first; the last one takes every checkpoint.

    Raises:
        RuntimeError: the checkpoint fails, or answers in the wrong shape.
    """
    network = _fastest(checkpoint, threads, name, kinds)
    controls = torch.zeros(2, checkpoint.horizon, device=checkpoint.device)
    times = torch.zeros(2, dtype=torch.int64, device=checkpoint.device)
    embedding = network.embed(torch.zeros(checkpoint.condition_size, device=checkpoint.device))
    for _ in range(WARM_UP_CALLS):
        network.predict(controls, times, embedding)
    return network


def _fastest(
    checkpoint: Checkpoint, threads: RowThreads, name: str, kinds: Sequence[Kind]
) -> Network:
    *faster, as_it_is = kinds
    for build in faster:
        try:
            network = build(checkpoint, threads)
            _check_agreement(network, checkpoint)
        except AnotherNetwork as error:
            log.debug("%s runs as TorchScript: %s", name, error)
        except UnsuitableNetwork as error:
            # A GPU is no reason to worry.
            level = logging.WARNING if checkpoint.device.type == "cpu" else logging.DEBUG
            log.log(level, "%s runs as TorchScript, slowly: %s", name, error)
        else:
            return network
    return as_it_is(checkpoint, threads)


def _check_agreement(network: Network, checkpoint: Checkpoint) -> None:
    """Compare predictions at some times, with and without a condition at each.

    Raises:
        RuntimeError: the checkpoint fails, or answers in the wrong shape.
        UnsuitableNetwork: the network predicts something else.
    """
    generator = torch.Generator().manual_seed(0)
    condition = torch.randn(checkpoint.condition_size, generator=generator)
    times = torch.linspace(0, checkpoint.num_timesteps - 1, CHECKED_TIMES)
    t = times.long().repeat_interleave(2)
    u_t = torch.randn(len(t), checkpoint.horizon, generator=generator)
    keep = torch.tensor([True, False]).repeat(CHECKED_TIMES)
    u_t, t, condition, keep = (x.to(checkpoint.device) for x in (u_t, t, condition, keep))
    expected = run_script(checkpoint.script, u_t, t, condition.expand(len(t), -1), keep)
    predicted = network.predict(u_t, t, network.embed(condition).repeat(CHECKED_TIMES, 1))
    difference = float((predicted - expected).abs().max())
    # Not ">": a NaN on either side is no agreement.
    if not difference <= TOLERANCE:
        raise UnsuitableNetwork(f"its predictions are {difference:.0e} from the checkpoint's")
