"""Whole samplings: the paper's sampler in eager PyTorch beside ours."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from app.benchmark.pairing import paired
from app.benchmark.reference import Reference
from app.inference.engine import EngineProposal
from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion, Learned
from app.planning.methods.sampler import PAPER_SAMPLER, Sampler, Samplers
from app.planning.problem import Problem

BUDGETS = (1, 16, 32, 128, 512)
CANDIDATES, MOST_PAIRS = 256, 40
"""Pairs of samplings are as many as make this many candidates, but 3 to 40."""


def sampling(
    paper: EngineProposal, reference: Reference, chosen: EngineProposal, samplers: Samplers
) -> Iterator[str]:
    """Draw candidates for one task by the reference and by the engine; yield a Markdown table.

    Args:
        paper: samples from the paper's model.
        reference: the same in eager PyTorch.
        chosen: samples from the model that a service chooses for the paper's plant.
        samplers: of the latter.
    """
    default = ActionDiffusion().settled(samplers)
    problem = Problem(np.zeros(2), np.array([0.5, 0.0]))
    yield (
        f"| K | reference | paper's setting, {_evaluations(PAPER_SAMPLER)} evaluations | ratio "
        f"| controls differ by | default, {_evaluations(default)} evaluations | ratio |"
    )
    yield "| ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    for k in BUDGETS:
        plain = partial(_sample_by_reference, reference, problem, k)
        same = partial(_sample_by_engine, paper, problem, k, PAPER_SAMPLER)
        fewer = partial(_sample_by_engine, chosen, problem, k, default)
        difference = np.abs(plain() - same()).max()
        pairs = min(max(3, CANDIDATES // k), MOST_PAIRS)
        reference_ms, same_ms = paired(plain, same, pairs, settle=True)
        again_ms, fewer_ms = paired(plain, fewer, pairs, settle=True)
        yield (
            f"| {k} | {reference_ms:.1f} ms | {same_ms:.1f} ms | {reference_ms / same_ms:.1f} "
            f"| {difference:.0e} m/s² | {fewer_ms:.2f} ms | {again_ms / fewer_ms:.0f} |"
        )


def _evaluations(sampler: Sampler) -> int:
    return sampler.cost(1).network_evaluations


def _sample_by_reference(reference: Reference, problem: Problem, k: int) -> FloatArray:
    noise = np.random.default_rng(k).standard_normal((k, problem.horizon))
    return reference.sample(problem, noise)


def _sample_by_engine(
    proposal: EngineProposal, problem: Problem, k: int, sampler: Sampler
) -> FloatArray:
    return Learned(sampler, proposal).propose(problem, k, np.random.default_rng(k)).controls
