"""From a method as it was asked for to one that can propose: a model settles it, then samples."""

from typing import cast

from app.planning.methods.action_diffusion import ActionDiffusion, Learned
from app.planning.methods.base import LearnedProposal, Method, MethodOptions, Named
from app.planning.methods.sampler import Sampler, Samplers
from app.planning.methods.warm_started import WarmStarted


def needs_model(asked: Named) -> bool:
    """Say whether a method, or what it starts from, samples from a learned model."""
    if isinstance(asked, WarmStarted):
        return needs_model(asked.initial)
    return isinstance(asked, ActionDiffusion)


def settled(asked: Named, samplers: Samplers | None) -> MethodOptions:
    """Return a method with nothing left open, so that its cost is known.

    Args:
        asked: with what a request says.
        samplers: of the model that it samples from; None where it needs none.

    Raises:
        ValueError: it needs a model.
    """
    if isinstance(asked, WarmStarted):
        return WarmStarted(asked.optimiser, settled(asked.initial, samplers))
    if isinstance(asked, ActionDiffusion):
        if samplers is None:
            raise ValueError(f"{asked.name} samples from a model")
        return asked.settled(samplers)
    return cast(MethodOptions, asked)


def able(method: MethodOptions, proposal: LearnedProposal | None) -> Method:
    """Return a settled method as one that can propose.

    Args:
        method: what `settled` returned.
        proposal: the model that it samples from; None where it needs none.
    """
    if isinstance(method, WarmStarted):
        return WarmStarted(method.optimiser, able(method.initial, proposal))
    if isinstance(method, Sampler):
        assert proposal is not None
        return Learned(method, proposal)
    return cast(Method, method)
