"""Refinement: from the candidates of any method to plans that arrive, through the true dynamics.

A wrapper around every method: it takes candidates and returns candidates. The descent of one of
them is in gauss_newton.py and leaving_rest.py, energy and smoothness in null_space.py, stuck steps
in waiting.py; a plan where none arrives comes from reachable/trace.py.
"""

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from annotated_types import Ge, Le

from app.compilation import compiled
from app.planning.arrays import BoolArray, FloatArray, IntArray
from app.planning.objectives import STUCK_STEPS, TERMINAL_ERROR, TOLERANCE, Objective
from app.planning.options import Options
from app.planning.plant.task import Task
from app.planning.problem import Cost, Problem
from app.planning.reachable.reachability import Reachability
from app.planning.reachable.trace import trace
from app.planning.refining.gauss_newton import EXACT, arrive, terminal_error_of
from app.planning.refining.leaving_rest import arrive_across_rests
from app.planning.refining.null_space import descend
from app.planning.refining.waiting import WAITING_ROLLOUTS, wait_at_the_end
from app.planning.stop import NEVER, Flag, Stop

AT_THE_FLOOR = 1e-9
"""A plan this near to the floor, m and m/s, is as good as one can be."""
PROGRAM_ROLLOUTS = 8
"""To follow a quadratic program of null_space.py, about: its steps are brought back to arrive."""


@dataclass(frozen=True, slots=True)
class Refinement(Options):
    """Descent of the terminal error from the candidates of a method."""

    iterations: Annotated[int, Ge(1), Le(1000)] = 40
    """Gauss-Newton steps at most, each time a descent starts."""
    num_refined: Annotated[int, Ge(1)] | None = None
    """How many candidates are refined, the best by terminal error; none means all of them."""
    repair: bool = True
    """Where no candidate arrives by descent alone, trace a plan that does: see `refine`."""

    def cost(self, num_candidates: int, objective: Objective = TERMINAL_ERROR) -> Cost:
        """Return an estimate of what `refine` takes where no candidate arrives, in whole rollouts.

        Where one arrives it takes a small part of that; what it took is known only afterwards
        (`Refined.rollouts`, where a rollout of a part of the horizon counts as one).
        """
        num_refined = min(self.num_refined or num_candidates, num_candidates)
        rollouts = num_candidates + 2 * self.iterations * num_refined  # with kicks out of rest
        if self.repair:
            rollouts += self.iterations
        if objective.sum_of_squares:
            rollouts += PROGRAM_ROLLOUTS * self.iterations * num_refined
        elif objective is STUCK_STEPS:
            rollouts += WAITING_ROLLOUTS * num_candidates
        return Cost(rollouts=rollouts)


@dataclass(frozen=True, slots=True)
class Refined:
    """Candidates after refinement, in the order in which they were proposed."""

    controls: FloatArray
    """(K, H), within the bounds."""
    errors_before: FloatArray
    """(K,), terminal errors of the candidates as they came."""
    errors: FloatArray
    """(K,), terminal errors of `controls`: none above the one before, give or take 1e-12, but for
    that of a plan from the robust search."""
    replaced: BoolArray
    """(K,), whether a traced plan, or one from the robust search, took the candidate's place."""
    rollouts: int
    """Rollouts spent, of the whole horizon or a part of it."""
    reachability: Reachability | None
    """Of the problem, where it was worked out on the way."""

    @classmethod
    def of(cls, problem: Problem, controls: FloatArray) -> Self:
        """Return candidates (K, H) as they were proposed."""
        errors = np.array([terminal_error_of(each, problem.task) for each in controls])
        none = np.zeros(len(controls), dtype=np.bool_)
        return cls(controls, errors, errors, none, rollouts=len(controls), reachability=None)


def refine(
    problem: Problem,
    controls: FloatArray,
    options: Refinement,
    objective: Objective = TERMINAL_ERROR,
    stop: Stop = NEVER,
) -> Refined:
    """Lower the terminal errors of candidates `controls` (K, H), clipped to the bounds first.

    From the best candidate to the worst, each is descended by damped Gauss-Newton with the exact
    derivative of the plant (gauss_newton.py), and where that stalls, by leaving a rest sooner
    (leaving_rest.py). Where the terminal error alone matters, the first to arrive ends the
    refinement.

    Descent keeps to the motion that a candidate has, and stalls where that is the wrong one: the
    mass turns too late or leaves in the wrong direction. If none has come to the floor, `repair`
    traces a plan back through the reachable set (reachable/trace.py), which is on the
    floor wherever that is exact, and puts it in the place of the worst refined candidate. Every
    change is kept only where the true rollout improves.

    With an objective that is a sum of squares the candidates that arrive equally well then descend
    it without leaving their terminal states (null_space.py), so that each is locally the least of
    its kind. The stuck steps are a count and have no slope: for them the candidates that arrive
    equally well do so at once and wait afterwards, where the target is at rest (waiting.py).
    `best_candidate` says which candidate is best.

    Args:
        problem: start, target, plant and horizon H.
        controls: (K, H); left as they are.
        options: how much to spend.
        objective: what to want among plans that arrive.
        stop: ends the refinement early.

    Raises:
        Stopped: `stop` said so.
    """
    task, iterations = problem.task, options.iterations
    lowest, highest = task.plant.lowest_control, task.plant.highest_control
    refined = np.clip(controls, lowest, highest, dtype=np.float64)
    replaced = np.zeros(len(refined), dtype=np.bool_)
    num_refined = min(options.num_refined or len(refined), len(refined))
    one_is_enough = objective is TERMINAL_ERROR
    errors_before, errors, chosen, rollouts = _descend(
        refined, task, iterations, num_refined, one_is_enough, stop.flag
    )
    bound = None
    if options.repair and errors.min() > EXACT:
        bound, traced = trace(problem, stop)
        if errors.min() > bound.floor + AT_THE_FLOOR:
            error, spent = arrive(traced, task, iterations, stop.flag)
            rollouts += spent
            worst = chosen[np.argmax(errors[chosen])]
            if error < errors[worst]:
                refined[worst], errors[worst] = traced, error
                replaced[worst] = True
    if objective.sum_of_squares:
        differences = objective.sum_of_squares == "differences"
        for i in np.flatnonzero(errors <= errors.min() + TOLERANCE):
            errors[i], spent = descend(refined[i], task, differences, iterations, stop.flag)
            rollouts += spent
    elif objective is STUCK_STEPS:
        arrived = np.flatnonzero(errors <= errors.min() + TOLERANCE)
        refined[arrived], errors[arrived] = wait_at_the_end(problem, refined[arrived])
        rollouts += WAITING_ROLLOUTS * len(arrived)
    stop.check()
    return Refined(refined, errors_before, errors, replaced, rollouts, bound)


@compiled
def _descend(
    controls: FloatArray,
    task: Task,
    iterations: int,
    num_refined: int,
    one_is_enough: bool,
    stopped: Flag,
) -> tuple[FloatArray, FloatArray, IntArray, int]:
    """Descend from `controls` (K, H) in place.

    Returns:
        The terminal errors before and after, (K,) each, which candidates were chosen to descend,
        and the rollouts.
    """
    errors = np.empty(len(controls))
    for i in range(len(controls)):
        errors[i] = terminal_error_of(controls[i], task)
    errors_before = errors.copy()
    rollouts = len(controls)
    chosen = np.argsort(errors)[:num_refined]
    for i in chosen:
        errors[i], spent = arrive_across_rests(controls[i], task, iterations, stopped)
        rollouts += spent
        if (errors[i] <= EXACT and one_is_enough) or stopped[0]:
            break
    return errors_before, errors, chosen, rollouts
