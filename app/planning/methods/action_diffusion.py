"""Action Diffusion (paper, Sect. 3): candidates from the learned p_theta(u | x0, x*)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from app.planning.methods.base import LearnedProposal
from app.planning.methods.sampler import (
    PAPER_SAMPLER,
    GuidanceScale,
    Sampler,
    Samplers,
    SamplerSettings,
    Steps,
)
from app.planning.options import Options
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop

SamplerName: TypeAlias = Literal["dpm_solver", "ddim", "paper"]


@dataclass(frozen=True, slots=True)
class ActionDiffusion(Options):
    """Sampling from the diffusion model with classifier-free guidance.

    These are options alone: a model settles what they leave open, and makes a method of them.
    """

    name: Literal["action_diffusion"] = "action_diffusion"
    sampler: SamplerName = "dpm_solver"
    """`dpm_solver` is DPM-Solver++ (2M); `paper` is `ddim` with the paper's 50 steps and guidance
    scale of 2."""
    steps: Steps | None = None
    """Denoising steps; by default the model's own (see /models)."""
    guidance_scale: GuidanceScale | None = None
    """s: 0 ignores the task, 1 samples the conditional model, above 1 sharpens it; by default the
    model's own (see /models)."""

    def check_combination(self) -> None:
        """Check what the ranges do not say.

        Raises:
            ValueError: an option changes the paper's sampler.
        """
        if self.sampler == "paper" and (self.steps, self.guidance_scale) != (None, None):
            raise ValueError("the paper's sampler has its own steps and guidance_scale; use ddim")

    def settled(self, samplers: Samplers) -> Sampler:
        """Return the sampler that is meant, of a model with these defaults."""
        if self.sampler == "paper":
            return PAPER_SAMPLER
        defaults: SamplerSettings = getattr(samplers, self.sampler)
        said: dict[str, Any] = {"steps": self.steps, "guidance_scale": self.guidance_scale}
        said = {name: value for name, value in said.items() if value is not None}
        return Sampler(self.sampler, replace(defaults, **said))


@dataclass(frozen=True, slots=True)
class Learned:
    """Action Diffusion that can propose: its sampler, and the model that it samples from."""

    sampler: Sampler
    proposal: LearnedProposal

    @property
    def name(self) -> str:
        """The method's."""
        return self.sampler.name

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Denoise (K, H) standard normal draws of `rng` into controls."""
        return self.propose_many([problem], num_candidates, [rng], stop)[0]

    def propose_many(
        self,
        problems: Sequence[Problem],
        num_candidates: int,
        rngs: Sequence[np.random.Generator],
        stop: Stop = NEVER,
    ) -> list[Candidates]:
        """Do the same for several problems, whose rows go through the network together."""
        begun = [
            self.proposal.begin(
                problem, rng.standard_normal((num_candidates, problem.horizon)), self.sampler
            )
            for problem, rng in zip(problems, rngs, strict=True)
        ]
        return [finish() for finish in begun]

    def cost(self, num_candidates: int) -> Cost:
        """The sampler's."""
        return self.sampler.cost(num_candidates)
