"""Refinement: from the candidates of any method to plans that arrive, through the true dynamics.

A wrapper around every method: it takes candidates and returns candidates. The descent of one of
them is in gauss_newton.py, other motions in repair.py, wishes among exact plans in objectives.py.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from app.planning.compilation import compiled
from app.planning.gauss_newton import EXACT, arrive, terminal_error_of
from app.planning.problem import Problem
from app.planning.repair import overwrite_best_window, switching_sequences
from app.planning.system import FloatArray, Parameters

NUM_RESTARTS = 32
RESTART_STRETCHES = 8
"""The switches of a restart lie at multiples of an eighth of the horizon."""
FINEST_WINDOWS = 64
"""Windows are moved by a 16th, a 32nd and at last a 64th of the horizon."""
MAX_WINDOWS = 6
"""Windows overwritten of each size."""


@dataclass(frozen=True, slots=True)
class Refinement:
    """Descent of the terminal error from the candidates of a method.

    Raises:
        ValueError: an option is out of its range.
    """

    __pydantic_config__ = {"extra": "forbid", "allow_inf_nan": False}

    iterations: Annotated[int, Ge(1), Le(1000)] = 40
    """Gauss-Newton steps at most, each time a descent starts."""
    num_refined: Annotated[int, Ge(1)] | None = None
    """How many candidates are refined, the best by terminal error; none means all of them."""
    repair: bool = True
    """Where no candidate arrives by descent alone, try other motions: see `refine`."""

    def __post_init__(self) -> None:
        if self.iterations < 1 or (self.num_refined is not None and self.num_refined < 1):
            raise ValueError("iterations and num_refined must be positive")


@dataclass(frozen=True, slots=True)
class Refined:
    """Candidates after refinement, in the order in which they were proposed."""

    controls: FloatArray
    """(K, H), within the bounds."""
    errors_before: FloatArray
    """(K,), terminal errors of the candidates as they came."""
    errors: FloatArray
    """(K,), terminal errors of `controls`; none above the one before."""
    replaced: NDArray[np.bool_]
    """(K,), whether a repair overwrote the candidate's own motion."""
    rollouts: int
    """Rollouts spent, of the whole horizon or a part of it."""


def refine(problem: Problem, controls: FloatArray, options: Refinement) -> Refined:
    """Lower the terminal errors of candidates `controls` (K, H), clipped to the bounds first.

    From the best candidate to the worst, each is descended by damped Gauss-Newton with the exact
    derivative of the plant (gauss_newton.py). The first to arrive ends the refinement.

    Descent keeps the motion that a candidate has, and stalls where that is the wrong one: nothing
    moves, the mass stops too early or leaves in the wrong direction. If none has arrived, `repair`
    descends from the sequences of three stretches that end nearest to the target (accelerate,
    coast, brake) and puts the best of them in the place of the worst refined candidate; then it
    overwrites windows of the best one with full or no control as long as that helps. Every change
    is kept only where the true rollout improves.
    """
    limit = problem.system.control_limit
    refined = np.clip(np.asarray(controls, dtype=np.float64), -limit, limit)
    errors_before, errors, replaced, rollouts = _refine(
        refined,
        problem.initial_state,
        problem.target_state,
        problem.system.parameters,
        options.iterations,
        len(refined) if options.num_refined is None else min(options.num_refined, len(refined)),
        options.repair,
    )
    return Refined(refined, errors_before, errors, replaced, rollouts)


@compiled
def _refine(
    controls: FloatArray,
    initial_state: FloatArray,
    target: FloatArray,
    parameters: Parameters,
    iterations: int,
    num_refined: int,
    repair: bool,
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], int]:
    """Refine `controls` (K, H) in place."""
    position, velocity = initial_state[0], initial_state[1]
    num_candidates = len(controls)
    errors = np.empty(num_candidates)
    for i in range(num_candidates):
        errors[i] = terminal_error_of(controls[i], position, velocity, target, parameters)
    errors_before = errors.copy()
    replaced = np.zeros(num_candidates, dtype=np.bool_)
    rollouts = num_candidates
    chosen = np.argsort(errors)[:num_refined]
    for i in chosen:
        errors[i], spent = arrive(controls[i], position, velocity, target, parameters, iterations)
        rollouts += spent
        if errors[i] <= EXACT:
            return errors_before, errors, replaced, rollouts
    if repair:
        worst = chosen[np.argmax(errors[chosen])]
        restart, error, spent = _restart(
            position, velocity, target, parameters, iterations, controls.shape[1]
        )
        rollouts += spent
        if error < errors[worst]:
            controls[worst], errors[worst], replaced[worst] = restart, error, True
        best = chosen[np.argmin(errors[chosen])]
        error, spent = _overwrite_windows(
            controls[best], position, velocity, target, parameters, iterations, errors[best]
        )
        rollouts += spent
        if error < errors[best]:
            errors[best], replaced[best] = error, True
    return errors_before, errors, replaced, rollouts


@compiled
def _restart(
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
    iterations: int,
    horizon: int,
) -> tuple[FloatArray, float, int]:
    """Return the best descent from a sequence of three stretches, its error and the rollouts."""
    stride = -(-horizon // RESTART_STRETCHES)
    starts, rollouts = switching_sequences(
        position, velocity, target, parameters, horizon, stride, NUM_RESTARTS
    )
    best, best_error = 0, np.inf
    for i in range(len(starts)):
        error, spent = arrive(starts[i], position, velocity, target, parameters, iterations)
        rollouts += spent
        if error < best_error:
            best, best_error = i, error
        if best_error <= EXACT:
            break
    return starts[best], best_error, rollouts


@compiled
def _overwrite_windows(
    controls: FloatArray,
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
    iterations: int,
    error: float,
) -> tuple[float, int]:
    """Overwrite windows of `controls` (H,) and descend, from the coarsest to the finest."""
    rollouts = 0
    for windows in (16, 32, FINEST_WINDOWS):
        stride = -(-controls.size // windows)
        for _ in range(MAX_WINDOWS):
            if error <= EXACT:
                return error, rollouts
            before = error
            error, spent = overwrite_best_window(
                controls, position, velocity, target, parameters, stride
            )
            rollouts += spent
            if error == before:
                break
            error, spent = arrive(controls, position, velocity, target, parameters, iterations)
            rollouts += spent
    return error, rollouts
