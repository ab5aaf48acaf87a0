"""Samplers of a learned model: what each does by default, and one with nothing left open."""

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from annotated_types import Ge, Le

from app.planning.options import Options
from app.planning.problem import Cost

Solver: TypeAlias = Literal["dpm_solver", "ddim"]
Steps: TypeAlias = Annotated[int, Ge(1), Le(1000)]
GuidanceScale: TypeAlias = Annotated[float, Ge(0), Le(20)]
Share: TypeAlias = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True, slots=True)
class SamplerSettings(Options):
    """What a solver does."""

    steps: Steps
    """Denoising steps."""
    guidance_scale: GuidanceScale
    """s: 0 ignores the condition, 1 samples the conditional model, above 1 sharpens it."""
    first_time: Share
    """The diffusion time at which the steps begin, as a share of T."""
    last_time: Share
    """That of the last step, the same."""

    def check_combination(self) -> None:
        """Check that the times fall.

        Raises:
            ValueError: the last time is before the first.
        """
        if self.last_time > self.first_time:
            raise ValueError("last_time must not exceed first_time: diffusion times fall")


@dataclass(frozen=True, slots=True)
class Samplers(Options):
    """What a model's solvers do where a request does not say it."""

    dpm_solver: SamplerSettings
    ddim: SamplerSettings


@dataclass(frozen=True, slots=True)
class Sampler:
    """Action Diffusion with nothing left open: what it costs is known."""

    solver: Solver
    settings: SamplerSettings

    @property
    def name(self) -> str:
        """The method's."""
        return "action_diffusion"

    def cost(self, num_candidates: int) -> Cost:
        """Two predictions a step, or one where guidance has only one to weigh (s = 0 or 1)."""
        predictions = 1 if self.settings.guidance_scale in (0.0, 1.0) else 2
        return Cost(
            network_evaluations=self.settings.steps * predictions,
            predictions_per_step=predictions,
        )


PAPER_SAMPLER = Sampler("ddim", SamplerSettings(50, 2.0, first_time=1.0, last_time=0.0))
"""The paper's (Table 2), whatever the model."""
PAPER_MODEL_SAMPLERS = Samplers(
    dpm_solver=SamplerSettings(3, 2.0, first_time=0.7, last_time=0.25),
    ddim=SamplerSettings(10, 1.5, first_time=1.0, last_time=0.0),
)
"""Of models that predict noise, on the paper's cosine schedule; found with `breakaway evaluate
sampler-frontier`."""
