"""Action Diffusion (paper, Sect. 3): candidates from the learned p_theta(u | x0, x*)."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le

from app.planning.methods.base import LearnedProposal
from app.planning.options import OPTION_CHECKS, check_ranges
from app.planning.problem import Candidates, Cost, Problem


@dataclass(frozen=True, slots=True)
class ActionDiffusion:
    """Sampling from the diffusion model with classifier-free guidance."""

    __pydantic_config__ = OPTION_CHECKS

    name: Literal["action_diffusion"] = "action_diffusion"
    sampler: Literal["ddim"] = "ddim"
    steps: Annotated[int, Ge(1), Le(1000)] = 50
    """Denoising steps; no more than the model was trained with."""
    guidance_scale: Annotated[float, Ge(0), Le(20)] = 2.0
    """s: 0 ignores the states, 1 samples the conditional model, above 1 sharpens it."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: an option is out of its range.
        """
        check_ranges(self)

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
    ) -> Candidates:
        """Denoise (K, H) standard normal draws of `rng` into controls.

        Raises:
            ValueError: no learned proposal was given.
        """
        if learned is None:
            raise ValueError("action_diffusion needs a learned proposal")
        noise = rng.standard_normal((num_candidates, problem.horizon))
        return learned.sample(problem, noise, self.sampler, self.steps, self.guidance_scale)

    def cost(self, num_candidates: int) -> Cost:
        """Two predictions a step, or one where guidance has only one to weigh (s = 0 or 1)."""
        predictions = 1 if self.guidance_scale in (0.0, 1.0) else 2
        return Cost(network_evaluations=self.steps * predictions)
