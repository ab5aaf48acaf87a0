"""What to want among plans that arrive equally well, and which candidate has most of it.

The descent of an objective is in null_space.py, its measures are those of metrics.py.
"""

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.planning.metrics import control_energy, control_smoothness, stuck_steps
from app.planning.plant.system import FloatArray
from app.planning.problem import Problem

Objective: TypeAlias = Literal[
    "terminal_error", "control_energy", "control_smoothness", "stuck_steps"
]

TOLERANCE = 1e-6
"""m and m/s: candidates whose terminal errors differ by less than this arrive equally well."""


def best_candidate(
    problem: Problem,
    controls: FloatArray,
    states: FloatArray,
    errors: FloatArray,
    objective: Objective = "terminal_error",
) -> int:
    """Return the index of the best candidate by `objective`.

    The candidates within `TOLERANCE` of the least terminal error are ranked by the objective, and
    by terminal error where it ties; "terminal_error" alone decides if it is the objective (the
    paper).

    Args:
        problem: the plant, and the target position for the stuck steps.
        controls: (K, H), m/s^2.
        states: (K, H+1, 2), from the rollout of `controls`.
        errors: (K,), terminal errors of `states`.
        objective: what to have least of.
    """
    if objective == "terminal_error":
        return int(np.argmin(errors))
    equal = np.flatnonzero(errors <= errors.min() + TOLERANCE)
    values = _values(problem, controls[equal], states[equal], objective)
    return int(equal[np.lexsort((errors[equal], values))[0]])


def _values(
    problem: Problem, controls: FloatArray, states: FloatArray, objective: Objective
) -> FloatArray | NDArray[np.int64]:
    if objective == "control_energy":
        return control_energy(controls)
    if objective == "control_smoothness":
        return control_smoothness(controls)
    return stuck_steps(states, controls, float(problem.target_state[0]), problem.system)
