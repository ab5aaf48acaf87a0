"""The words everybody speaks: Problem, Candidates, Cost, Plan, MultistepPlan."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from app.planning.system import FloatArray, System

DEFAULT_HORIZON = 64
"""H of the paper (Table 2)."""


class PlanningError(Exception):
    """A method could not propose usable controls, through no fault of the request."""


def as_state(value: ArrayLike) -> FloatArray:
    """Return `value` as a state [p, v] of shape (2,), in m and m/s.

    Raises:
        ValueError: not two finite numbers.
    """
    state = np.asarray(value, dtype=np.float64)
    if state.shape != (2,) or not np.all(np.isfinite(state)):
        raise ValueError("a state is two finite numbers, position (m) and velocity (m/s)")
    return state


@dataclass(frozen=True, slots=True)
class Problem:
    """From `initial_state` x0 (2,) to `target_state` x* (2,) in `horizon` H steps of `system`.

    Raises:
        ValueError: a state is not two finite numbers, or the horizon is not positive.
    """

    initial_state: FloatArray
    target_state: FloatArray
    system: System = field(default_factory=System)
    horizon: int = DEFAULT_HORIZON

    def __post_init__(self) -> None:
        object.__setattr__(self, "initial_state", as_state(self.initial_state))
        object.__setattr__(self, "target_state", as_state(self.target_state))
        if self.horizon < 1:
            raise ValueError("the horizon must be at least one step")


@dataclass(frozen=True, slots=True)
class Cost:
    """What a plan takes; known before any of it is spent."""

    network_evaluations: int = 0
    """Forward passes of the network, each over all candidates."""
    rollouts: int = 0
    """Control sequences rolled out over the whole horizon."""

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(
            self.network_evaluations + other.network_evaluations, self.rollouts + other.rollouts
        )


@dataclass(frozen=True, slots=True)
class Timing:
    """Wall-clock milliseconds a plan spent in each stage."""

    queue: float = 0.0
    """Waiting for the network."""
    propose: float = 0.0
    rollout: float = 0.0
    """Rolling out, ranking and measuring."""

    def __add__(self, other: "Timing") -> "Timing":
        return Timing(
            self.queue + other.queue, self.propose + other.propose, self.rollout + other.rollout
        )

    @property
    def total(self) -> float:
        return self.queue + self.propose + self.rollout


@dataclass(frozen=True, slots=True)
class Candidates:
    """What a method proposes: control sequences (K, H) in m/s^2, and how long they waited (ms)."""

    controls: FloatArray
    queue_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class RankedCandidates:
    """All candidates of a plan as they were rolled out, in the order proposed."""

    controls: FloatArray
    """(K, H)."""
    states: FloatArray
    """(K, H+1, 2)."""
    terminal_errors: FloatArray
    """(K,)."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The best candidate of one problem, with the measures of that very rollout."""

    controls: FloatArray
    """(H,)."""
    states: FloatArray
    """(H+1, 2)."""
    terminal_error: float
    control_energy: float
    control_smoothness: float
    stuck_steps: int
    cost: Cost
    timing: Timing
    candidates: RankedCandidates


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
