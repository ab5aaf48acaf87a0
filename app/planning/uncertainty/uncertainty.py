"""What a plan is to cope with, as one value: the plants, the risk, and how hard to look."""

from dataclasses import dataclass, replace

from app.planning.arrays import FloatArray
from app.planning.problem import Cost
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.risk import MEAN, Risk

NUM_FEW = 8
"""Plants that stand for all of them where many motions are looked at."""
NUM_JUDGES = 256
"""Plants that a plan is judged on, where they can be drawn apart from those it was made with."""
MAX_SYSTEMS = 128
MAX_MOTIONS = 8192
DEFAULT_MOTIONS = 1024
FEW_MOTIONS = 64
"""Drawn by default beside candidates that a model made for all plants."""
ROBUST_WORTH = 16
"""Motions for which such a candidate stands: so many more stay in every stage."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage of the successive halving: how many of the motions stay, and how far they descend."""

    share: float
    iterations: int

    def count(self, num_motions: int) -> int:
        """Return how many of `num_motions` stay: one at least."""
        return max(1, round(self.share * num_motions))


STAGES = Stage(1 / 8, 2), Stage(1 / 16, 6)
"""On a few of the plants; what comes out of them is finished on all."""
FINISHED = Stage(1 / 128, 40)
ROLLOUTS_PER_ITERATION = 2.5
"""On each plant, about: the slope, and the trials of a step."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The plants that may be the true one, and what is wanted of a plan for them."""

    ensemble: Ensemble
    """What the plan is made for and ranked by."""
    judges: Ensemble
    """What it is judged on: drawn apart, or the same where the plants were given."""
    corners: Ensemble | None = None
    """Extreme plants, on which a robust refinement looks as well."""
    risk: Risk = MEAN
    num_motions: int = DEFAULT_MOTIONS
    """Drawn, beside the candidates, as starts of a robust refinement."""
    relative: Relative | None = None
    """How the plants were drawn; None where they were given."""
    is_robust: bool = True
    """Whether plans are made for all the plants, or for the problem's own and judged on them."""
    candidate_worth: int = 0
    """Motions for which each candidate stands: `ROBUST_WORTH` where a model made it for all."""

    def after(self, controls: FloatArray) -> "Uncertainty":
        """Return what is uncertain once `controls` (N,) have been carried out."""
        return replace(
            self,
            ensemble=self.ensemble.after(controls),
            judges=self.judges.after(controls),
            corners=self.corners and self.corners.after(controls),
        )

    @property
    def refined_on(self) -> Ensemble:
        """The ensemble and the corners."""
        return self.ensemble.joined(self.corners) if self.corners else self.ensemble

    def risks(self, controls: FloatArray, target_state: FloatArray) -> FloatArray:
        """Return the risk of each of `controls` (K, H): (K,), in m."""
        return self.risk.of(self.ensemble.errors(controls, target_state))

    def beside_a_model(self, num_motions: int) -> "Uncertainty":
        """Return the same for candidates that a model makes for all plants."""
        return replace(self, num_motions=num_motions, candidate_worth=ROBUST_WORTH)

    def num_starts(self, num_candidates: int) -> int:
        """Return by how many motions the stages of a search are measured."""
        return self.num_motions + self.candidate_worth * num_candidates

    def cost(self, num_candidates: int, *, refined: bool) -> Cost:
        """Return what ranking and judging take, and with `refined` an estimate of the search."""
        if not self.is_robust:
            return Cost(rollouts=len(self.judges))
        rollouts = num_candidates * len(self.ensemble) + len(self.judges)
        if refined:
            few = min(NUM_FEW, len(self.ensemble))
            starts = self.num_starts(num_candidates)
            rollouts += (num_candidates + self.num_motions) * few
            descents = sum(stage.count(starts) * stage.iterations for stage in STAGES)
            rollouts += int(ROLLOUTS_PER_ITERATION * few * descents)
            finished = (FINISHED.count(starts) + 1) * FINISHED.iterations
            rollouts += int(ROLLOUTS_PER_ITERATION * len(self.refined_on) * finished)
        return Cost(rollouts=rollouts)
