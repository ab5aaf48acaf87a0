"""What to want among plans that arrive equally well, and which candidate has most of it.

What lowers them is in refining/ (null_space.py, waiting.py), their measures are in metrics.py.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.planning.arrays import FloatArray
from app.planning.metrics import control_energy, control_smoothness, stuck_steps
from app.planning.problem import Problem

SAME = 1e-9
"""Measures (relative) and errors (m) that differ by less than this are a tie."""

Measure: TypeAlias = Callable[[Problem, FloatArray, FloatArray], NDArray[np.number]]
"""(problem, controls (K, H), states (K, H+1, 2)) -> (K,), of which less is better."""
ObjectiveName: TypeAlias = Literal[
    "terminal_error", "control_energy", "control_smoothness", "stuck_steps"
]

TOLERANCE = 1e-6
"""m and m/s: candidates whose terminal errors differ by less than this arrive equally well."""


@dataclass(frozen=True, slots=True)
class Objective:
    """What ranks candidates that arrive equally well."""

    name: ObjectiveName
    measure: Measure | None
    """None where the terminal error alone decides (the paper)."""
    sum_of_squares: Literal["controls", "differences"] | None = None
    """What refinement can descend: the sum of the squares of the controls, or of the differences
    between neighbours."""


TERMINAL_ERROR = Objective("terminal_error", None)
CONTROL_ENERGY = Objective(
    "control_energy", lambda _problem, controls, _states: control_energy(controls), "controls"
)
CONTROL_SMOOTHNESS = Objective(
    "control_smoothness",
    lambda _problem, controls, _states: control_smoothness(controls),
    "differences",
)
STUCK_STEPS = Objective(
    "stuck_steps",
    lambda problem, controls, states: stuck_steps(
        states, controls, float(problem.target_state[0]), problem.system
    ),
)
OBJECTIVES: dict[ObjectiveName, Objective] = {
    objective.name: objective
    for objective in (TERMINAL_ERROR, CONTROL_ENERGY, CONTROL_SMOOTHNESS, STUCK_STEPS)
}


def best_candidate(
    problem: Problem,
    controls: FloatArray,
    states: FloatArray,
    errors: FloatArray,
    objective: Objective = TERMINAL_ERROR,
    error_limit: float = math.inf,
) -> int:
    """Return the index of the best candidate by `objective`.

    The candidates within `TOLERANCE` of the least terminal error are ranked by the objective's
    measure, and by terminal error where it ties; of those that tie in that as well, the first is
    the best, so that no machine's rounding decides.

    Args:
        problem: the plant, and the target position for the stuck steps.
        controls: (K, H).
        states: (K, H+1, 2), from the rollout of `controls`.
        errors: (K,), terminal errors of `states`.
        objective: what to have least of.
        error_limit: m; a candidate with a greater terminal error is the best only if all have one.
    """
    least = errors.min()
    if objective.measure is None or least > error_limit:
        return int(np.argmin(errors))
    equal = np.flatnonzero(errors <= min(least + TOLERANCE, error_limit))
    values = objective.measure(problem, controls[equal], states[equal])
    least_value = float(values.min())
    tied = equal[values <= least_value + SAME * abs(least_value)]
    nearest = tied[errors[tied] <= errors[tied].min() + SAME]
    return int(nearest[0])
