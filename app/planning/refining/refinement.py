"""Refinement: from the candidates of any method to plans that arrive, through the true dynamics.

A wrapper around every method: it takes candidates and returns candidates. The descent of one of
them is in gauss_newton.py, other motions in repair.py, energy and roughness in null_space.py.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from app.compilation import compiled
from app.planning.objectives import TOLERANCE, Objective
from app.planning.options import OPTION_CHECKS, check_ranges
from app.planning.plant.system import FloatArray, Parameters
from app.planning.problem import Cost, Problem
from app.planning.refining.gauss_newton import EXACT, arrive, terminal_error_of
from app.planning.refining.null_space import descend
from app.planning.refining.repair import overwrite_best_window, switching_sequences
from app.planning.stop import NEVER, Flag, Stop

NUM_RESTARTS = 32
RESTART_STRETCHES = 8
"""The switches of a restart lie at multiples of an eighth of the horizon."""
FINEST_WINDOWS = 64
"""Windows are moved by a 16th, a 32nd and at last a 64th of the horizon."""
MAX_WINDOWS = 6
"""Windows overwritten of each size."""


@dataclass(frozen=True, slots=True)
class Refinement:
    """Descent of the terminal error from the candidates of a method."""

    __pydantic_config__ = OPTION_CHECKS

    iterations: Annotated[int, Ge(1), Le(1000)] = 40
    """Gauss-Newton steps at most, each time a descent starts."""
    num_refined: Annotated[int, Ge(1)] | None = None
    """How many candidates are refined, the best by terminal error; none means all of them."""
    repair: bool = True
    """Where no candidate arrives by descent alone, try other motions: see `refine`."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: an option is out of its range.
        """
        check_ranges(self)
        if self.num_refined is not None and self.num_refined < 1:
            raise ValueError("num_refined must be at least 1")

    def cost(self, num_candidates: int) -> Cost:
        """Return about what `refine` takes at most; what it took is known only afterwards."""
        return Cost(rollouts=2 * self.iterations * (num_candidates + NUM_RESTARTS))


@dataclass(frozen=True, slots=True)
class Refined:
    """Candidates after refinement, in the order in which they were proposed."""

    controls: FloatArray
    """(K, H), within the bounds."""
    errors_before: FloatArray
    """(K,), terminal errors of the candidates as they came."""
    errors: FloatArray
    """(K,), terminal errors of `controls`: none above the one before, give or take 1e-12."""
    replaced: NDArray[np.bool_]
    """(K,), whether a repair overwrote the candidate's own motion."""
    rollouts: int
    """Rollouts spent, of the whole horizon or a part of it."""


def refine(
    problem: Problem,
    controls: FloatArray,
    options: Refinement,
    objective: Objective = "terminal_error",
    stop: Stop = NEVER,
) -> Refined:
    """Lower the terminal errors of candidates `controls` (K, H), clipped to the bounds first.

    From the best candidate to the worst, each is descended by damped Gauss-Newton with the exact
    derivative of the plant (gauss_newton.py). Where the terminal error alone matters, the first to
    arrive ends the refinement.

    Descent keeps the motion that a candidate has, and stalls where that is the wrong one: nothing
    moves, the mass stops too early or leaves in the wrong direction. If none has arrived, `repair`
    descends from the sequences of three stretches that end nearest to the target (accelerate,
    coast, brake) and puts the best of them in the place of the worst refined candidate; then it
    overwrites windows of the best one with full or no control as long as that helps. Every change
    is kept only where the true rollout improves.

    With the objective "control_energy" or "control_smoothness" the candidates that arrive equally
    well then descend it without leaving their terminal states (null_space.py), so that each is
    locally the least of its kind. The stuck steps are a count and have no slope: that objective
    only asks for every candidate to arrive. Which candidate is best says `best_candidate`.

    Args:
        problem: start, target, plant and horizon H.
        controls: (K, H), m/s^2; left as they are.
        options: how much to spend.
        objective: what to want among plans that arrive.
        stop: ends the refinement early.

    Raises:
        Stopped: `stop` said so.
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
        objective == "terminal_error",
        stop.flag,
    )
    if objective in ("control_energy", "control_smoothness"):
        rollouts += _descend_equals(
            refined,
            errors,
            problem.initial_state,
            problem.target_state,
            problem.system.parameters,
            objective == "control_smoothness",
            options.iterations,
            stop.flag,
        )
    stop.check()
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
    one_is_enough: bool,
    stopped: Flag,
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
        errors[i], spent = arrive(
            controls[i], position, velocity, target, parameters, iterations, stopped
        )
        rollouts += spent
        if (errors[i] <= EXACT and one_is_enough) or stopped[0]:
            break
    if repair and errors.min() > EXACT and not stopped[0]:
        worst = chosen[np.argmax(errors[chosen])]
        restart, error, spent = _restart(
            position, velocity, target, parameters, iterations, controls.shape[1], stopped
        )
        rollouts += spent
        if error < errors[worst]:
            controls[worst], errors[worst], replaced[worst] = restart, error, True
        best = chosen[np.argmin(errors[chosen])]
        error, spent = _overwrite_windows(
            controls[best],
            position,
            velocity,
            target,
            parameters,
            iterations,
            errors[best],
            stopped,
        )
        rollouts += spent
        if error < errors[best]:
            errors[best], replaced[best] = error, True
    return errors_before, errors, replaced, rollouts


@compiled
def _descend_equals(
    controls: FloatArray,
    errors: FloatArray,
    initial_state: FloatArray,
    target: FloatArray,
    parameters: Parameters,
    roughness: bool,
    iterations: int,
    stopped: Flag,
) -> int:
    """Descend the objective of the candidates that arrive as well as the best; return rollouts."""
    rollouts = 0
    for i in np.flatnonzero(errors <= errors.min() + TOLERANCE):
        if stopped[0]:
            break
        errors[i], spent = descend(
            controls[i],
            initial_state[0],
            initial_state[1],
            target,
            parameters,
            roughness,
            iterations,
            stopped,
        )
        rollouts += spent
    return rollouts


@compiled
def _restart(
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
    iterations: int,
    horizon: int,
    stopped: Flag,
) -> tuple[FloatArray, float, int]:
    """Return the best descent from a sequence of three stretches, its error and the rollouts."""
    stride = -(-horizon // RESTART_STRETCHES)
    starts, rollouts = switching_sequences(
        position, velocity, target, parameters, horizon, stride, NUM_RESTARTS
    )
    best, best_error = 0, np.inf
    for i in range(len(starts)):
        error, spent = arrive(
            starts[i], position, velocity, target, parameters, iterations, stopped
        )
        rollouts += spent
        if error < best_error:
            best, best_error = i, error
        if best_error <= EXACT or stopped[0]:
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
    stopped: Flag,
) -> tuple[float, int]:
    """Overwrite windows of `controls` (H,) and descend, from the coarsest to the finest."""
    rollouts = 0
    for windows in (16, 32, FINEST_WINDOWS):
        stride = -(-controls.size // windows)
        for _ in range(MAX_WINDOWS):
            if error <= EXACT or stopped[0]:
                return error, rollouts
            before = error
            error, spent = overwrite_best_window(
                controls, position, velocity, target, parameters, stride
            )
            rollouts += spent
            if error == before:
                break
            error, spent = arrive(
                controls, position, velocity, target, parameters, iterations, stopped
            )
            rollouts += spent
    return error, rollouts
