"""The words everybody speaks: Problem, Candidates, Cost, Timing. What comes out is in plan.py."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from app.planning.arrays import FloatArray
from app.planning.plant.rollout import rollout
from app.planning.plant.spread import Told
from app.planning.plant.system import System
from app.planning.plant.task import Task

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


def state_after(controls: ArrayLike, initial_state: FloatArray, system: System) -> FloatArray:
    """Return the state (2,), in m and m/s, that `controls` (N,) lead to from `initial_state` (2,).

    With the controls that are on their way to the actuator, it is where a plan starts.
    """
    sequence = np.asarray(controls, dtype=np.float64)
    return as_state(rollout(system, initial_state, sequence[np.newaxis])[0, -1])


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

    @property
    def task(self) -> Task:
        """The problem as the kernels take it."""
        return Task(
            float(self.initial_state[0]),
            float(self.initial_state[1]),
            float(self.target_state[0]),
            float(self.target_state[1]),
            self.system.plant,
        )


@dataclass(frozen=True, slots=True)
class Cost:
    """What a plan took, or will take: then all is exact but the rollouts of a refinement."""

    network_evaluations: int = 0
    """Forward passes of the network, each over all candidates."""
    rollouts: int = 0
    """Control sequences rolled out, over the whole horizon or, in a refinement, a part of it."""
    predictions_per_step: int = 0
    """Evaluations that need not wait for each other: guidance weighs two of a candidate, or one."""

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(
            self.network_evaluations + other.network_evaluations,
            self.rollouts + other.rollouts,
            max(self.predictions_per_step, other.predictions_per_step),
        )


@dataclass(frozen=True, slots=True)
class Timing:
    """Wall-clock milliseconds a plan spent in each stage."""

    queue: float = 0.0
    """Waiting, for a core or for the network."""
    propose: float = 0.0
    refine: float = 0.0
    rollout: float = 0.0
    """Rolling out, ranking and measuring, the floor of the error too."""

    def __add__(self, other: "Timing") -> "Timing":
        return Timing(
            self.queue + other.queue,
            self.propose + other.propose,
            self.refine + other.refine,
            self.rollout + other.rollout,
        )

    @property
    def total(self) -> float:
        return self.queue + self.propose + self.refine + self.rollout


@dataclass(frozen=True, slots=True)
class Candidates:
    """What a method proposes: control sequences (K, H), and how long they waited (ms)."""

    controls: FloatArray
    queue_ms: float = 0.0
    denoising: FloatArray | None = None
    """(S+1, K, H), units of control: before S denoising steps, after each, and so at last
    `controls`. Of methods that denoise, where it is kept."""
    told: Told | None = None
    """What the model was told of an uncertain plant: then the candidates are for all that it may
    be, and a descent on the problem's own would spoil them. None: nothing."""
