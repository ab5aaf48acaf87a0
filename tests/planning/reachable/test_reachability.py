"""The floor, held against rollouts, searches and cases done by hand.

How the reachable set is computed is not looked at here, only what it claims.
"""

import math
from dataclasses import replace

import numpy as np
import psutil
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.methods import CEM, DatasetPrior
from app.planning.planner import plan
from app.planning.plant.friction import (
    breaking_away,
    can_rest,
    holding_control,
    resting_controls,
)
from app.planning.plant.rollout import rollout, terminal_state
from app.planning.plant.system import Plant, System
from app.planning.problem import Problem
from app.planning.reachable.reachability import REACHABLE_WITHIN, Reachability, reachability
from app.planning.recipe import Recipe
from tests.planning.plants import lopsided, machines, mirrored

SEEDS = st.integers(0, 2**32 - 1)
ROUNDING = 1e-9


def random_system(rng: np.random.Generator) -> System:
    """Any plant, those on the edges of the parameters' ranges often."""
    if rng.random() < 0.2:
        return System()
    coulomb = rng.choice([0.0, 0.5, rng.uniform(0, 1)])
    static = coulomb + rng.choice([0.0, 0.1, rng.uniform(0, 0.5)])
    limit = rng.choice([rng.uniform(0.05, 2), static + 0.01, 1.2 * static + 0.05, coulomb + 1e-3])
    time_step = rng.choice([0.01, 0.05, 0.1, 0.3])
    threshold = rng.choice([1e-3, 1e-2, 0.1, time_step * max(static - coulomb, 1e-3)])
    damping = rng.choice([0.0, 0.05, rng.uniform(0, 3)])
    system = System(
        static,
        coulomb,
        damping,
        control_limit=limit,
        time_step=time_step,
        velocity_threshold=threshold,
    )
    if rng.random() < 0.5:
        system = lopsided(system, rng)
    if rng.random() < 0.2:
        system = replace(system, stribeck_velocity=10 ** rng.uniform(-2.5, 0))
    return system


def random_controls(
    rng: np.random.Generator, system: System, num_candidates: int, horizon: int
) -> FloatArray:
    """Noise, holds, bang-bang, kicks and controls just past the breakaway force."""
    plant, shape = system.plant, (num_candidates, horizon)
    lowest, highest = plant.lowest_control, plant.highest_control
    noise = rng.uniform(lowest, highest, shape)
    held = np.repeat(noise, int(rng.integers(1, horizon + 1)), axis=1)[:, :horizon]
    extreme = np.where(held > 0, highest, lowest)
    resting = resting_controls(plant)
    past = 0.1 * (highest - lowest) * rng.random(shape)
    kinds = (
        noise,
        held,
        extreme,
        np.where(rng.random(shape) < 0.5, extreme, holding_control(plant)),
        np.where(held > 0, resting.high + past, resting.low - past),
    )
    return np.clip(kinds[rng.integers(len(kinds))], lowest, highest)


def random_start(rng: np.random.Generator, system: System) -> FloatArray:
    threshold = system.velocity_threshold
    slow = rng.uniform(-1.5, 1.5) * threshold
    velocity = rng.choice([0.0, slow, threshold, rng.uniform(-0.1, 0.1), rng.uniform(-1, 1)])
    return np.array([rng.uniform(-1, 1), velocity])


def hops_in_many_ways(system: System) -> bool:
    """Say whether the set may fall into so many pieces that holes are filled: a bound only then."""
    hops = [breaking_away(direction, system.plant) for direction in (1.0, -1.0)]
    return any(
        0.0 < hop.high - hop.low < min(abs(hop.low), abs(hop.high))
        and max(abs(hop.low), abs(hop.high)) < system.velocity_threshold
        for hop in hops
    )


def floor_of(system: System, start: FloatArray, target: FloatArray, horizon: int) -> Reachability:
    return reachability(Problem(start, target, system, horizon))


@settings(deadline=None, max_examples=100)
@given(SEEDS)
def test_whatever_was_reached_is_reachable(seed: int) -> None:
    rng = np.random.default_rng(seed)
    system, horizon = random_system(rng), int(rng.choice([1, 2, 3, 4, 6, 10, 20, 40]))
    start = random_start(rng, system)
    controls = random_controls(rng, system, 2, horizon)
    for states in rollout(system, start, controls):
        result = floor_of(system, start, states[-1], horizon)
        assert result.reachable
        assert result.minimum_steps is not None
        assert result.minimum_steps <= horizon


@settings(deadline=None, max_examples=40)
@given(SEEDS)
def test_no_sampled_plan_beats_the_floor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    system, horizon = random_system(rng), int(rng.choice([1, 2, 3, 5, 10, 30]))
    start, target = random_start(rng, system), rng.uniform(-0.5, 0.5, 2)
    result = floor_of(system, start, target, horizon)
    controls = random_controls(rng, system, 500, horizon)
    ends = rollout(system, start, controls)[:, -1]
    nearest = np.linalg.norm(ends - target, axis=1).min()
    assert nearest >= result.floor - result.floor_error - ROUNDING


@pytest.mark.parametrize("method", [DatasetPrior(), CEM()])
def test_no_method_beats_the_floor(method: DatasetPrior | CEM) -> None:
    rng = np.random.default_rng(1)
    gaps = []
    for _ in range(5):
        problem = Problem(np.zeros(2), np.array([rng.uniform(-2, 2), rng.uniform(-0.2, 0.2)]))
        error = plan(problem, Recipe(method, 64), rng).terminal_error
        gaps.append(error - reachability(problem).floor)
    assert min(gaps) >= -ROUNDING


@settings(deadline=None, max_examples=40)
@given(SEEDS)
def test_the_nearest_state_is_reachable_at_the_distance_of_the_floor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    system, horizon = random_system(rng), int(rng.choice([1, 2, 4, 10, 30]))
    start, target = random_start(rng, system), rng.uniform(-1, 1, 2)
    result = floor_of(system, start, target, horizon)
    assert math.isclose(
        float(np.linalg.norm(result.nearest_state - target)), result.floor, abs_tol=1e-12
    )
    again = floor_of(system, start, result.nearest_state, horizon)
    # The state itself is known only to within the error of the floor that it belongs to.
    assert again.floor <= result.floor_error + again.floor_error + REACHABLE_WITHIN


@settings(deadline=None, max_examples=40)
@given(SEEDS)
def test_the_mirrored_problem_of_the_mirrored_plant_has_the_same_floor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    system, horizon = random_system(rng), int(rng.choice([1, 3, 10, 30]))
    start, target = random_start(rng, system), rng.uniform(-1, 1, 2)
    one = floor_of(system, start, target, horizon)
    other = floor_of(mirrored(system), -start, -target, horizon)
    inexact = one.floor_error + other.floor_error
    assert math.isclose(one.floor, other.floor, abs_tol=1e-9 + inexact)
    if inexact == 0.0:
        assert one.minimum_steps == other.minimum_steps


@settings(deadline=None, max_examples=25)
@given(SEEDS)
def test_from_rest_more_steps_never_hurt_and_the_fewest_are_the_fewest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    system, start = random_system(rng), np.array([0.3, 0.0])
    assume(not hops_in_many_ways(system) and can_rest(system.plant))
    target = start + rng.uniform(-0.1, 0.1, 2) * rng.choice([0.0, 1.0], 2)
    results = {horizon: floor_of(system, start, target, horizon) for horizon in range(1, 16)}
    inexact = results[15].floor_error
    for horizon in range(2, 16):
        assert results[horizon].floor <= results[horizon - 1].floor + ROUNDING + 2 * inexact
    fewest = results[15].minimum_steps
    for horizon, result in results.items():
        assert result.reachable == (fewest is not None and horizon >= fewest)
        assert result.minimum_steps == (fewest if result.reachable else None)


@settings(deadline=None, max_examples=60)
@given(machines(), SEEDS)
def test_the_floor_holds_for_whatever_differs_by_direction(system: System, seed: int) -> None:
    plant = system.plant
    rng = np.random.default_rng(seed)
    horizon = int(rng.choice([1, 2, 3, 6, 20]))
    start = rng.choice([0.0, 1.0], 2) * rng.uniform(-1, 1, 2)
    controls = np.repeat(
        rng.uniform(plant.lowest_control, plant.highest_control, (20, horizon)),
        int(rng.integers(1, horizon + 1)),
        axis=1,
    )[:, :horizon]
    ends = rollout(system, start, controls)[:, -1]

    assert floor_of(system, start, ends[0], horizon).reachable
    target = ends[0] + rng.uniform(-0.5, 0.5, 2)
    result = floor_of(system, start, target, horizon)
    inexact = result.floor_error + ROUNDING
    assert np.linalg.norm(ends - target, axis=1).min() >= result.floor - inexact
    again = floor_of(system, start, result.nearest_state, horizon)
    assert again.floor <= result.floor_error + again.floor_error + REACHABLE_WITHIN
    image = floor_of(mirrored(system), -start, -target, horizon)
    assert math.isclose(result.floor, image.floor, abs_tol=2 * inexact)


def test_a_mass_that_cannot_hold_still_cannot_wait() -> None:
    # Each step at rest, it slips: by dt (2.0 - 0.9 - 0.6) = 0.025 m/s more, or by up to 0.115.
    slipping = System(bias=2.0)
    start = np.zeros(2)

    assert floor_of(System(), start, start, 1).minimum_steps == 0
    for horizon in (1, 2, 5):
        result = floor_of(slipping, start, start, horizon)
        assert not result.reachable
        # All the while with full control against it: p and v at the least.
        steps = np.arange(1, horizon + 1)
        velocities = 0.5 * (1 - (1 - 0.05 * 0.05) ** steps) / 0.05
        nearest = math.hypot(0.05 * velocities.sum(), velocities[-1])
        assert result.floor == pytest.approx(nearest, abs=1e-12)


def test_a_floor_says_how_far_it_may_be_off() -> None:
    start, target = np.zeros(2), np.array([0.4, 0.1])
    assert floor_of(System(), start, target, 64).floor_error == 0.0
    weakening = System(stribeck_velocity=0.1)
    assert 0.0 < floor_of(weakening, start, target, 64).floor_error <= 1e-6
    hopping = System(static_friction=0.89, velocity_threshold=0.05)
    assert floor_of(hopping, start, np.array([3.0, 0.3]), 64).floor_error > 1e-9


def test_however_a_set_falls_apart_its_pieces_stay_few() -> None:
    # All velocities count as at rest, and each step breaks away from each: pieces would double.
    all_at_rest = System(0.7, 0.001, 0.001, time_step=0.5, velocity_threshold=1e6)
    start, target = np.array([1.0, -1e6]), np.array([0.2, 0.0])

    result = floor_of(all_at_rest, start, target, 64)

    states = rollout(all_at_rest, start, np.full((1, 64), 0.9))[0]
    assert result.floor <= np.linalg.norm(states[-1] - target)
    assert result.floor_error > 0


def test_a_stuck_plant_stays() -> None:
    system = System(static_friction=0.9, control_limit=0.9)
    result = floor_of(system, np.array([0.1, 0.0]), np.array([0.4, 0.4]), 64)
    assert not result.reachable
    assert math.isclose(result.floor, 0.5)
    assert result.nearest_state.tolist() == [0.1, 0.0]
    assert result.minimum_steps is None


def test_a_start_on_its_target_takes_no_step_if_it_can_stay() -> None:
    assert floor_of(System(), np.zeros(2), np.zeros(2), 5).minimum_steps == 0


@pytest.mark.parametrize(
    ("problem", "calls"),
    [
        (Problem(np.zeros(2), np.array([1.4, 0.0])), 500),
        (Problem(np.array([0.0, 0.3]), np.array([1.4, 0.5])), 500),
        (Problem(np.zeros(2), np.array([1.4, 0.0]), horizon=2), 20_000),
        (Problem(np.zeros(2), np.ones(2), System(control_limit=0.7), 1024), 100),
    ],
    ids=["from rest", "moving", "short", "stuck"],
)
def test_many_calls_leave_no_memory_behind(problem: Problem, calls: int) -> None:
    resident = []
    for _ in range(2):
        for _ in range(calls):
            reachability(problem)
        resident.append(psutil.Process().memory_info().rss)

    assert resident[1] - resident[0] < 2**20


# With dt = 1, b = 0, f_s = 2, f_c = 1 and u_max = 4, breaking away takes v from 0 to (1, 3], and
# sliding changes it by anything in [-5, 3] short of a reversal.
BY_HAND = System(2.0, 1.0, 0.0, control_limit=4.0, time_step=1.0, velocity_threshold=1e-3)


@pytest.mark.parametrize(
    ("start", "target", "horizon", "floor"),
    [
        # One step from rest: p = v in {0} or +-(1, 3].
        ((0, 0), (2, 2), 1, 0.0),
        ((0, 0), (4, 4), 1, math.sqrt(2)),
        ((0, 0), (0.5, 0.5), 1, math.sqrt(0.5)),
        # One step while sliding at 2: v in [0, 5], p = v.
        ((0, 2), (5, 5), 1, 0.0),
        ((0, 2), (0, 0), 1, 0.0),
        ((0, 2), (-1, -1), 1, math.sqrt(2)),
        # Hop and stop: rest at 0 or +-(1, 3].
        ((0, 0), (2, 0), 2, 0.0),
        ((0, 0), (0.4, 0), 2, 0.4),
        ((0, 0), (4, 0), 2, math.sqrt(0.5)),  # (3.5, 0.5), by 3 and 0.5
        # Three steps, 3 + 5 + 0 = 8 covered at most; 4 = 2.5 + 1.5 + 0.
        ((0, 0), (4, 0), 3, 0.0),
        ((0, 0), (8, 0), 3, 0.0),
        ((0, 0), (9, 0), 3, math.sqrt(0.2)),  # (8.8, 0.4), by 3, 5.4 and 0.4
        # A moving start that stops, then breaks away backwards.
        ((0, 2), (-2, -2), 2, 0.0),
        ((0, 2), (-3, 0), 3, 0.0),
    ],
)
def test_cases_by_hand(
    start: tuple[float, float], target: tuple[float, float], horizon: int, floor: float
) -> None:
    result = floor_of(BY_HAND, np.array(start, float), np.array(target, float), horizon)
    assert math.isclose(result.floor, floor, abs_tol=1e-12)


@compiled
def _search(
    rng: np.random.Generator,
    start: FloatArray,
    target: FloatArray,
    horizon: int,
    plant: Plant,
    restarts: int,
    steps: int,
) -> float:
    """Return the least terminal error that a multi-start local search finds."""
    lowest, highest = plant.lowest_control, plant.highest_control
    limit, resting = 0.5 * (highest - lowest), resting_controls(plant)
    least_forward = min(highest, max(lowest, resting.high))
    least_backward = min(highest, max(lowest, resting.low))
    levels = np.array([lowest, least_backward, holding_control(plant), least_forward, highest])
    best = np.inf
    controls, trial = np.empty(horizon), np.empty(horizon)
    for _ in range(restarts):
        level = levels[rng.integers(0, 5)]
        for k in range(horizon):
            if rng.random() < 3.0 / horizon:
                level = levels[rng.integers(0, 5)]
            controls[k] = level
        p, v = terminal_state(controls, start[0], start[1], plant)
        error = math.hypot(p - target[0], v - target[1])
        spread = limit
        for i in range(steps):
            spread = limit * 10.0 ** (-7.0 * i / steps)
            trial[:] = controls
            for _ in range(rng.integers(1, 4)):
                k = int(rng.integers(0, horizon))
                trial[k] += spread * rng.standard_normal()
                if rng.random() < 0.2:
                    trial[k] = levels[rng.integers(0, 5)] * (1 + 1e-6 * rng.random())
                trial[k] = min(highest, max(lowest, trial[k]))
            p, v = terminal_state(trial, start[0], start[1], plant)
            found = math.hypot(p - target[0], v - target[1])
            if found <= error:
                error = found
                controls[:] = trial
        best = min(best, error)
    return float(best)


def gap_of_search(rng: np.random.Generator, horizons: list[int], restarts: int) -> float:
    """Return how far a search ends above the floor of a random problem."""
    system, horizon = random_system(rng), int(rng.choice(horizons))
    start = random_start(rng, system)
    reach = horizon * system.time_step
    target = start + rng.uniform(-1, 1, 2) * np.array([0.5 * reach**2 + 0.3 * reach, 0.5 * reach])
    result = floor_of(system, start, target, horizon)
    found = _search(rng, start, target, horizon, system.plant, restarts, 1500)
    return float(found - result.floor + result.floor_error)


def test_a_search_comes_to_the_floor_and_not_below() -> None:
    rng = np.random.default_rng(3)
    gaps = np.array([gap_of_search(rng, [1, 2, 3, 4, 6], 30) for _ in range(40)])
    assert gaps.min() >= -ROUNDING
    assert np.mean(gaps <= 1e-3) >= 0.95


@pytest.mark.slow
def test_a_search_comes_to_the_floor_and_not_below_in_thousands_of_cases() -> None:
    rng = np.random.default_rng(4)
    gaps = np.array([gap_of_search(rng, [1, 2, 3, 4, 6, 10, 16], 60) for _ in range(2000)])
    assert gaps.min() >= -ROUNDING
    assert np.mean(gaps <= 1e-3) >= 0.97


@pytest.mark.slow
def test_thousands_of_rollouts_end_where_the_floor_is_zero() -> None:
    rng = np.random.default_rng(5)
    for _ in range(1000):
        system, horizon = random_system(rng), int(rng.choice([2, 4, 8, 16, 32, 64]))
        start = random_start(rng, system)
        controls = random_controls(rng, system, 4, horizon)
        for states in rollout(system, start, controls):
            assert floor_of(system, start, states[-1], horizon).reachable


def test_velocities_that_hardly_differ_take_no_longer() -> None:
    """Pieces that share no velocities are not joined: there came to be ever more of them."""
    hardly = System(0.0, 0.0, control_gain=1e-6, time_step=1e-6)

    bound = reachability(Problem(np.zeros(2), np.array([0.2, 0.0]), hardly, 64))

    assert bound.floor == pytest.approx(0.2)
    assert bound.floor_error < 1e-6
