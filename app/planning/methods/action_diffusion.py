"""Action Diffusion (paper, Sect. 3): candidates from the learned p_theta(u | x0, x*)."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from annotated_types import Ge, Le

from app.planning.methods.base import LearnedProposal
from app.planning.options import Options
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop

Sampler: TypeAlias = Literal["dpm_solver", "ddim", "paper"]
Solver: TypeAlias = Literal["dpm_solver", "ddim"]


class SamplerSettings(NamedTuple):
    """What a sampler does where the request does not say."""

    solver: Solver
    steps: int
    guidance_scale: float


SAMPLER_SETTINGS: dict[Sampler, SamplerSettings] = {
    "dpm_solver": SamplerSettings("dpm_solver", 3, 2.0),
    "ddim": SamplerSettings("ddim", 10, 1.5),
    "paper": SamplerSettings("ddim", 50, 2.0),
}
"""Found with `breakaway evaluate sampler-frontier`; the last one is the paper's Table 2."""


@dataclass(frozen=True, slots=True)
class ActionDiffusion(Options):
    """Sampling from the diffusion model with classifier-free guidance.

    These are options alone; with a model they make a method, `Learned`.
    """

    name: Literal["action_diffusion"] = "action_diffusion"
    sampler: Sampler = "dpm_solver"
    """`dpm_solver` is DPM-Solver++ (2M); `paper` is `ddim` with the paper's steps and guidance."""
    steps: Annotated[int, Ge(1), Le(1000)] | None = None
    """Denoising steps; by default 3 (`dpm_solver`), 10 (`ddim`) or 50 (`paper`)."""
    guidance_scale: Annotated[float, Ge(0), Le(20)] | None = None
    """s: 0 ignores the states, 1 samples the conditional model, above 1 sharpens it; by default 2
    (`dpm_solver`, `paper`) or 1.5 (`ddim`)."""

    def check_combination(self) -> None:
        """Check what the ranges do not say.

        Raises:
            ValueError: an option changes the paper's sampler.
        """
        if self.sampler == "paper" and (self.steps, self.guidance_scale) != (None, None):
            raise ValueError("the paper's sampler has its own steps and guidance_scale; use ddim")

    @property
    def settings(self) -> SamplerSettings:
        """What the sampler does, nothing left open."""
        settings = SAMPLER_SETTINGS[self.sampler]
        if self.steps is not None:
            settings = settings._replace(steps=self.steps)
        if self.guidance_scale is not None:
            settings = settings._replace(guidance_scale=self.guidance_scale)
        return settings

    def cost(self, num_candidates: int) -> Cost:
        """Two predictions a step, or one where guidance has only one to weigh (s = 0 or 1)."""
        settings = self.settings
        predictions = 1 if settings.guidance_scale in (0.0, 1.0) else 2
        return Cost(
            network_evaluations=settings.steps * predictions, predictions_per_step=predictions
        )


@dataclass(frozen=True, slots=True)
class Learned:
    """Action Diffusion that can propose: its options, and the model that they are for."""

    options: ActionDiffusion
    proposal: LearnedProposal

    @property
    def name(self) -> str:
        """The method's."""
        return self.options.name

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Denoise (K, H) standard normal draws of `rng` into controls."""
        noise = rng.standard_normal((num_candidates, problem.horizon))
        return self.proposal.sample(problem, noise, *self.options.settings)

    def cost(self, num_candidates: int) -> Cost:
        """The options'."""
        return self.options.cost(num_candidates)
