"""What a plan is worth on plants that are not known."""

from dataclasses import dataclass

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.spread import Told
from app.planning.problem import Problem
from app.planning.uncertainty.risk import Risk
from app.planning.uncertainty.uncertainty import Uncertainty

NUM_SHOWN = 32
"""Plants whose trajectories are kept."""
TOLERANCES = (0.01, 0.05)
"""m: errors that count as having arrived."""


@dataclass(frozen=True, slots=True)
class Robustness:
    """Terminal errors of one plan over the plants that it is judged on, m."""

    num_systems: int
    risk: Risk
    value: float
    """The risk."""
    mean_error: float
    median_error: float
    p90_error: float
    worst_error: float
    rms_error: float
    within: dict[str, float]
    """Share of the plants whose error is at most so much, by the tolerance in m."""
    nominal_error: float
    """On the plant of the problem."""
    first_order_bound: float | None
    """The least r.m.s. error of any control sequence, to first order; None where none is known."""
    errors: FloatArray
    """(S,): of each plant."""
    fan: FloatArray
    """(min(S, 32), H+1, 2): what the plan does on some of the plants, spread evenly."""
    told: Told | None
    """What the model was told of the plants that the plan is for, where one proposed it."""


def judge(
    problem: Problem,
    controls: FloatArray,
    nominal_error: float,
    uncertainty: Uncertainty,
    told: Told | None = None,
) -> Robustness:
    """Carry `controls` (H,) out on every plant, and measure how near they end."""
    errors = uncertainty.judges.errors(controls[np.newaxis], problem.target_state)[0]
    median, nine_in_ten = np.quantile(errors, (0.5, 0.9)).tolist()
    few = uncertainty.judges.spread(NUM_SHOWN)
    bound = None
    starts_are_known = np.all(uncertainty.ensemble.states == problem.initial_state)
    if uncertainty.relative and starts_are_known:
        bound = uncertainty.relative.least_rms_error(problem)
    return Robustness(
        num_systems=len(errors),
        risk=uncertainty.risk,
        value=float(uncertainty.risk.of(errors)),
        mean_error=float(errors.mean()),
        median_error=median,
        p90_error=nine_in_ten,
        worst_error=float(errors.max()),
        rms_error=float(np.sqrt(np.mean(errors**2))),
        within={f"{limit:g}": float(np.mean(errors <= limit)) for limit in TOLERANCES},
        nominal_error=nominal_error,
        first_order_bound=bound,
        errors=errors,
        fan=few.trajectories(controls),
        told=told,
    )
