"""What planning gives: a Plan, a MultistepPlan, and the candidates behind them."""

from dataclasses import dataclass

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.denoising import Denoising
from app.planning.metrics import diversity
from app.planning.problem import Cost, Timing
from app.planning.reachable.outline import Outline
from app.planning.reachable.reachability import Reachability
from app.planning.uncertainty.robustness import Robustness


@dataclass(frozen=True, slots=True)
class RankedCandidates:
    """All candidates of a plan as they were rolled out, in the order proposed."""

    controls: FloatArray
    """(K, H)."""
    states: FloatArray
    """(K, H+1, 2)."""
    terminal_errors: FloatArray
    """(K,)."""

    @property
    def diversity(self) -> float:
        """How far they lie apart, in units of control."""
        return diversity(self.controls)


@dataclass(frozen=True, slots=True)
class RefinementEffect:
    """What refinement did to the best terminal error."""

    error_before: float
    """Of the best candidate as proposed."""
    error_after: float
    """Of the selected one; above `error_before` by no more than rounding, 1e-12, unless the risk
    over uncertain plants selects it."""
    replaced: bool
    """Whether a plan traced through the reachable set, or one from the robust search, took the
    selected candidate's place."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The best candidate of one problem, with the measures of that very rollout."""

    controls: FloatArray
    """(H,)."""
    states: FloatArray
    """(H+1, 2)."""
    terminal_error: float
    reachability: Reachability | None
    """How near any plan could come, where that was asked for."""
    outline: Outline | None
    """Of the reachable set, where that was asked for."""
    control_energy: float
    control_smoothness: float
    stuck_steps: int
    refinement: RefinementEffect | None
    robustness: Robustness | None
    """What the plan is worth on uncertain plants, where it is for such."""
    cost: Cost
    timing: Timing
    candidates: RankedCandidates
    denoising: Denoising | None
    """How the candidates came out of noise, where that was kept."""

    @property
    def gap(self) -> float | None:
        """Terminal error less its floor, where that is known; rounding never makes it negative."""
        if self.reachability is None:
            return None
        return max(0.0, self.terminal_error - self.reachability.floor)


@dataclass(frozen=True, slots=True)
class MultistepPlan:
    """Plans for M targets, one after the other, and the sequence that they compose."""

    segments: tuple[Plan, ...]
    controls: FloatArray
    """(M*H,)."""
    states: FloatArray
    """(M*H+1, 2)."""
    final_error: float
    """Terminal error of the last segment."""
    mean_end_error: float
    """Terminal error averaged over the segments."""
    stuck_steps: int
    cost: Cost
    timing: Timing

    @property
    def mean_end_floor(self) -> float | None:
        """Floor of the terminal error averaged over the segments, each from where it starts."""
        floors = [part.reachability.floor for part in self.segments if part.reachability]
        return float(np.mean(floors)) if floors else None
