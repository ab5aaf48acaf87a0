"""What a plan can reach at best: the exact reachable set of the plant, and the floor of the error.

Nothing here plans: no controls are computed, only the states that some controls would reach.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import can_rest, is_symmetric
from app.planning.plant.task import Task
from app.planning.problem import Problem
from app.planning.reachable.curves import straightening
from app.planning.reachable.polylines import (
    Nearest,
    Piece,
    add,
    nearer,
    nearest_in_piece,
    no_pieces,
)
from app.planning.reachable.regimes import ReachableSet, advance
from app.planning.stop import NEVER, Flag, Stop

REACHABLE_WITHIN = 1e-9
"""A target this close to the reachable set counts as in it (m and m/s in one Euclidean norm).

Relative to the largest coordinate of start and target where that exceeds one.
"""


@dataclass(frozen=True, slots=True)
class Reachability:
    """How near to its target a problem can end, whatever the method."""

    reachable: bool
    """Whether the floor is zero, to within `REACHABLE_WITHIN`."""
    floor: float
    """Least terminal error ||x_H - x*||_2 over all admissible controls."""
    floor_error: float
    """How far the floor may be off, m: 0 where it is exact."""
    nearest_state: FloatArray
    """Terminal state [p, v] (2,) at that distance, in m and m/s."""
    nearest_steps: int
    """Steps of motion that lead there, at most H: a start at rest waits before them, and a target
    at rest is held after them."""
    minimum_steps: int | None
    """Fewest steps, at most H, that lead to a target that is reachable in H; None if it is not.

    0 if the target is the start. A plan that takes this few steps need not end with a wait: whether
    the target can also be reached in every number of steps up to H is another question.
    """


def reachability(problem: Problem, stop: Stop = NEVER) -> Reachability:
    r"""Return how near to its target `problem` can end, in the plant's exact discrete dynamics.

    One step chooses the next velocity w from a set V(v), and the position follows: p' = p + dt*w.
    With a = 1 - b*dt,

    - sliding, v >= eps_v:  w = max(0, a*v + s),  s in dt*[-u_max - f_c, u_max - f_c];
    - sliding, v <= -eps_v: its mirror image;
    - at rest, |v| < eps_v: w = 0 (stuck), or, if u_max > f_s, w = v +- s with
      s in dt*(f_s - f_c, u_max - f_c] (breaking away; the gap up to dt*(f_s - f_c) is the dead
      zone).

    Where the plant differs by direction, each regime has its own numbers; with a bias beyond static
    friction and the control's reach there is no waiting at rest.

    So let X_n be the set of states after exactly n steps, and X_n(w) its slice of positions at
    velocity w. One step, in one of these regimes r, is

        X_{n+1}(w) = dt*w + union over v in [(w - hi_r)/a_r, (w - lo_r)/a_r] of X_n(v),

    with v also in the band of velocities of that regime. If every slice of a connected piece of
    X_n is an interval [L(v), U(v)], the union is the interval between the least L and the greatest
    U in that window, and the image is such a piece again: the upper bound is the Minkowski sum of
    the hypograph of U with the segment [lo_r, hi_r], which moves its rising edges by lo_r and its
    falling edges by hi_r (a bang-bang control, switched at the peak). A piece is therefore two
    polylines over v, exact, with some two vertices more each step.

    A step cuts each piece at v = +-eps_v, maps the parts through their regimes, and joins images
    where their slices overlap. Holes, which the dead zone leaves near the start, keep pieces apart
    until enough hops fill them. States at rest, v = 0, are intervals of their own: what enters the
    band |v| < eps_v may stop there and wait. Stops, waits, reversals and passages through the band
    without a stop are thus all covered, in any number. Only beyond 32 pieces (seen where
    u_max is barely above f_s and eps_v at least twice the dead zone, so that breaking away takes
    several steps inside the band) are the narrowest holes filled; the floor is then a lower bound,
    and a target in such a hole counts as reachable. With Stribeck's effect a sliding mass keeps a
    share of its velocity that is no longer the same at all of them: edges that bend are made of
    straight ones, to within a millionth over all steps (curves.py). `floor_error` says what both
    come to.

    The floor is the distance from the target to X_H. Open ends (the dead zone, the band) are
    treated as closed, so it is an infimum that may be approached only.

    From a start at rest that can wait, X_H is the union of all A_n with n <= H: the states n steps
    after the mass has left for the first time. Each is found from the one before, and none of them
    holds the start or any other of them again; the floor is the least distance from all of them.

    The cost grows with the square of the horizon. Propagation ends early where the target is
    reached and the start can wait (at v = 0) or the target be held (v* = 0).

    Raises:
        Stopped: `stop` said so.
    """
    within = tolerance_of(problem)
    first, found = _measure(displaced(problem), problem.horizon, within, stop.flag)
    stop.check()
    return described(problem, within, first, found)


def displaced(problem: Problem) -> Task:
    """Return the task in displacements from the start, so that its size costs no digits."""
    task = problem.task
    return task._replace(position=0.0, target_position=task.target_position - task.position)


def tolerance_of(problem: Problem) -> float:
    """Return how near to the reachable set a target counts as in it."""
    states = problem.initial_state, problem.target_state
    scale = max(1.0, *(float(np.abs(state).max()) for state in states))
    straightened = 2.0 * problem.horizon * straightening(problem.horizon, problem.task.plant)
    return REACHABLE_WITHIN * scale + straightened


def described(problem: Problem, within: float, first: int, found: "Found") -> Reachability:
    """Return what was found of a problem, from what `propagate` says of its displacements."""
    nearest = found.state
    reachable = nearest.distance <= within
    return Reachability(
        reachable=reachable,
        floor=nearest.distance,
        floor_error=found.inexact,
        nearest_state=np.array([problem.initial_state[0] + nearest.y, nearest.v]),
        nearest_steps=found.steps,
        minimum_steps=first if reachable else None,
    )


class Found(NamedTuple):
    """The nearest state of some sets, and which of them has it."""

    state: Nearest
    steps: int
    inexact: float
    """How far that state may be from a true one, m."""


class Sets(NamedTuple):
    """The reachable sets of all steps, one after the other."""

    uppers: list[FloatArray]
    lowers: list[FloatArray]
    """Of all pieces."""
    rests: list[FloatArray]
    """One array a step."""
    begins: list[int]
    """Where the pieces of each step begin, and of one more."""


@compiled
def _measure(task: Task, horizon: int, tolerance: float, stopped: Flag) -> tuple[int, Found]:
    # The sets of a long horizon take a lot of memory, and the floor needs the last one alone.
    first, best, _ = propagate(task, horizon, tolerance, False, stopped)
    return first, best


@compiled
def propagate(
    task: Task, horizon: int, tolerance: float, keeps: bool, stopped: Flag
) -> tuple[int, Found, Sets]:
    """Return the first step within `tolerance` (-1: none), and the state that a plan can end in.

    Positions start at zero. Also returns the sets on the way there, if it `keeps` them, or the
    first of them alone.
    """
    target_p, target_v = task.target_position, task.target_velocity
    # What is reached from a standstill is its own mirror image: half of it tells all.
    symmetric = task.velocity == 0.0 and is_symmetric(task.plant)
    # All waiting may be done at the start then, before the mass leaves it.
    departs = task.velocity == 0.0 and can_rest(task.plant)
    may_wait = departs or (can_rest(task.plant) and target_v == 0.0)
    states = _start_of(task)
    uppers, lowers = states.pieces.uppers.copy(), states.pieces.lowers.copy()
    sets = Sets(uppers, lowers, [states.rests], [0, len(uppers)])
    first, best = -1, Found(Nearest(math.inf, 0.0, 0.0), 0, 0.0)
    for n in range(horizon + 1):
        if stopped[0]:
            break
        if n > 0:
            states = advance(states, symmetric, horizon, task.plant)
            if n == 1 and departs:
                # One step after a start at rest, those states that have left it.
                states = ReachableSet(states.pieces, np.empty((0, 2)), states.inexact)
            if keeps:
                uppers.extend(states.pieces.uppers)
                lowers.extend(states.pieces.lowers)
                sets.rests.append(states.rests)
                sets.begins.append(len(uppers))
        # Without waiting only the last set counts, the others for the fewest steps alone.
        counts = departs or n == horizon
        within = best.state.distance if counts else tolerance
        nearest = _nearest(states, target_p, target_v, within)
        if symmetric:
            other = _nearest(states, -target_p, -target_v, min(within, nearest.distance))
            if other.distance < nearest.distance:
                nearest = Nearest(other.distance, -other.y, -other.v)
        arrives = first < 0 and nearest.distance <= tolerance
        if arrives:
            first = n
        if (counts or (arrives and may_wait)) and nearest.distance < best.state.distance:
            best = Found(nearest, n, states.inexact)
        if arrives and may_wait:
            break
    return first, best, sets


@compiled
def _start_of(task: Task) -> ReachableSet:
    """Return the set of the initial state alone, at position zero."""
    pieces = no_pieces()
    if task.velocity == 0.0:
        return ReachableSet(pieces, np.zeros((1, 2)), 0.0)
    line = np.zeros((1, 2))
    line[0, 0] = task.velocity
    add(pieces, Piece(line, line))
    return ReachableSet(pieces, np.empty((0, 2)), 0.0)


@compiled
def _nearest(states: ReachableSet, p: float, v: float, within: float) -> Nearest:
    """Return the state nearest to (p, v); its distance is infinite if it exceeds `within`."""
    nearest = Nearest(math.inf, math.nan, math.nan)
    for rest in states.rests:
        position = min(max(p, rest[0]), rest[1])
        nearest = nearer(nearest, Nearest(math.hypot(p - position, v), position, 0.0), within)
    pieces = states.pieces
    for i in range(len(pieces.uppers)):
        piece = Piece(pieces.uppers[i], pieces.lowers[i])
        bound = min(within, nearest.distance)
        nearest = nearer(nearest, nearest_in_piece(p, v, piece, bound), within)
        if nearest.distance == 0.0:
            break
    return nearest
