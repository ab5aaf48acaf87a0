"""What planning anew in every step does, and the pitfalls of it."""

from dataclasses import replace

import numpy as np
import pytest

from app.planning.control import RecedingHorizon
from app.planning.control.observer import Observer
from app.planning.control.simulation import Disturbance, Sensor, ToldOf, TrueMachine, simulate
from app.planning.control.step import Fallback, Goal, Measurement, control_step
from app.planning.methods import CEM
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import ControlLimits, System
from app.planning.problem import Problem
from app.planning.reachable.reachability import reachability
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.planning.uncertainty.ensemble import Ensemble
from tests.planning.control.controllers import EXACT, OFF, run

PLAIN = RecedingHorizon(observer=None)
LEARNS = RecedingHorizon(observer=EXACT)
START, TARGET = (0.0, 0.0), 0.3


def least_steps(target: float) -> int:
    """Return the fewest steps that lead there on the default plant."""
    bound = reachability(Problem(np.zeros(2), np.array([target, 0.0]), horizon=128))
    assert bound.minimum_steps is not None
    return bound.minimum_steps


def test_on_its_own_model_it_arrives_with_the_deadline_and_not_before() -> None:
    runs = run(PLAIN, truth=System(), start=(0.0, 0.3), deadline=60)

    assert runs.errors[0, 60] < 1e-3
    assert runs.settling_steps[0] <= 60


@pytest.mark.parametrize("target", [0.02, 0.1, 0.5])
def test_without_a_deadline_it_is_there_nearly_as_early_as_can_be(target: float) -> None:
    runs = run(PLAIN, truth=System(), target=target, deadline=None)

    assert runs.settling_steps[0] <= least_steps(target) + 5
    assert runs.final_errors[0] < 1e-3


def test_the_deadline_passed_it_goes_on_as_early_as_it_can() -> None:
    runs = run(PLAIN, truth=System(), target=0.5, deadline=5)

    assert runs.errors[0, 5] > 0.3
    assert runs.settling_steps[0] <= least_steps(0.5) + 12


def test_the_least_energy_takes_the_time_that_there_is() -> None:
    hasty, saving = (
        run(replace(LEARNS, objective=objective), target=0.2)
        for objective in ("terminal_error", "control_energy")
    )

    assert saving.final_errors[0] < 1e-3
    assert saving.energies[0] < 0.9 * hasty.energies[0]


def test_plans_that_are_followed_for_a_while_are_made_as_seldom() -> None:
    memory, made = None, []
    for k in range(12):
        controller = replace(PLAIN, replan_every=4)
        taken = control_step(
            controller, System(), Measurement(0.01 * k, 0.2), Goal(0.5, 64), memory
        )
        memory = taken.memory
        made.append(taken.predicted_error is not None)

    assert made == [True, False, False, False] * 3


def test_identification_arrives_where_plans_are_made_seldom() -> None:
    blind, learning = (
        run(replace(controller, replan_every=16), target=0.5) for controller in (PLAIN, LEARNS)
    )

    assert learning.errors[0, 64] < 0.3 * blind.errors[0, 64]
    assert learning.final_errors[0] < 1e-3


def test_the_last_plan_is_where_the_next_one_starts_from() -> None:
    first = control_step(PLAIN, System(), Measurement(0.0, 0.1), Goal(0.3, 40))
    p, v = first.predicted_states[1]
    second = control_step(PLAIN, System(), Measurement(p, v), Goal(0.3, 39), first.memory)

    np.testing.assert_allclose(second.plan, first.plan[1:])


def test_a_target_that_changes_on_the_way_is_gone_to() -> None:
    first = control_step(LEARNS, System(), Measurement(0.0, 0.2), Goal(0.3))
    second = control_step(LEARNS, System(), Measurement(0.01, 0.21), Goal(-0.3), first.memory)

    assert first.control > 0.0
    assert second.control < 0.0
    assert second.predicted_error == pytest.approx(0.0, abs=1e-3)


def test_what_is_at_rest_and_would_stay_so_gets_no_control() -> None:
    # Pitfall: a control below static friction does nothing, and costs energy.
    runs = run(LEARNS, truth=System(0.84, 0.7), target=0.05)
    at_rest = np.abs(runs.states[0, :-1, 1]) < 1e-3
    below = np.abs(runs.controls[0]) < 0.56

    assert np.all(runs.controls[0][at_rest & below] == 0.0)
    assert np.any(at_rest)


def test_it_kicks_with_what_there_is() -> None:
    # Pitfall: with a reserve of 5 % such a plant would never move.
    runs = run(LEARNS, truth=System(0.87, 0.7), target=0.1)

    assert runs.final_errors[0] < 1e-3


def test_a_delay_that_is_told_is_planned_for_and_one_that_is_not_makes_it_hunt() -> None:
    told, untold = (
        run(PLAIN, truth=System(), target=0.3, delay_steps=1, of_delay=of_delay)
        for of_delay in (True, False)
    )

    assert told.final_errors[0] < 1e-3
    assert told.moving_steps[0] == 0
    assert untold.moving_steps[0] > told.moving_steps[0]


def test_differences_of_noisy_positions_make_it_hunt_and_the_observer_does_not() -> None:
    sensor = Sensor(1e-3, 1e-3 * 2**0.5 / 0.05)  # what differences of positions have
    raw = run(PLAIN, sensor=sensor, seeds=10)
    looking = RecedingHorizon(observer=Observer(1e-3))
    filtered = run(looking, sensor=replace(sensor, measures_velocity=False), seeds=10)

    assert raw.hunting.mean() >= 0.2
    assert filtered.hunting.mean() == 0.0
    assert filtered.final_errors.max() < 0.01


@pytest.mark.parametrize("steps_left", [None, 64])
def test_what_full_control_does_not_move_is_unreachable(steps_left: int | None) -> None:
    weak = System(control_limit=0.5)
    taken = control_step(PLAIN, weak, Measurement(0.0, 0.0), Goal(0.3, steps_left))

    assert taken.status == "unreachable"
    assert taken.control == 0.0


def test_too_early_a_deadline_is_unreachable_and_it_goes_there_all_the_same() -> None:
    taken = control_step(PLAIN, System(), Measurement(0.0, 0.0), Goal(0.5, 12))

    assert taken.status == "unreachable"
    assert taken.control > 0.7


def test_a_deadline_that_leaves_time_lets_it_hold_first_or_last() -> None:
    runs = run(PLAIN, truth=System(), target=0.02, deadline=64)

    assert runs.errors[0, 64] < 1e-3
    assert {2} <= set(runs.statuses[0, 64:].tolist())


def test_a_target_too_far_for_any_plan_is_approached_all_the_same() -> None:
    quick = System(time_step=1e-3)
    runs = run(PLAIN, truth=quick, model=quick, target=0.5, deadline=None, steps=4000)

    assert runs.final_errors[0] < 1e-3
    assert runs.settling_steps[0] * 1e-3 < 1.1 * least_steps(0.5) * 0.05


@pytest.mark.parametrize("name", list(MACHINES))
@pytest.mark.parametrize("deadline", [None, 64])
def test_it_arrives_on_every_machine(name: str, deadline: int | None) -> None:
    machine = MACHINES[name]
    off = replace(machine.system, control_gain=0.97 * machine.system.control_gain)
    target = 0.3 if name == "servo" else 0.05
    runs = simulate(
        TrueMachine(machine.system, delay_steps=machine.delay_steps),
        (0.0, 0.0),
        LEARNS,
        ToldOf(off, target, deadline),
        300,
        [0],
    )

    assert runs.final_errors[0] < 1e-3
    assert not runs.hunting[0]


def test_limits_of_one_side_and_a_slope_are_no_trouble() -> None:
    lift = System(0.2, 0.15, bias=-1.0, control_limit=ControlLimits(0.0, 2.5))
    runs = run(LEARNS, truth=replace(lift, coulomb_friction=0.18), model=lift, target=0.2)

    assert runs.final_errors[0] < 1e-3
    assert runs.states[0, -1, 1] == 0.0


def test_a_fallback_is_asked_where_no_plan_arrives_and_taken_where_it_is_better() -> None:
    recipe = Recipe(CEM(iterations=20), 32, Refinement())
    hard = Goal(0.0003, 12)
    measurement = Measurement(0.0, 0.0)
    fine = replace(PLAIN, dead_band=1e-5)
    alone = control_step(fine, System(), measurement, hard)
    helped = control_step(
        fine,
        System(),
        measurement,
        hard,
        fallback=Fallback(recipe, np.random.default_rng(0)),
    )

    assert alone.predicted_error is not None
    assert helped.predicted_error is not None
    assert helped.predicted_error <= alone.predicted_error
    error = np.hypot(*(helped.predicted_states[-1] - [0.0003, 0.0]))
    assert error == pytest.approx(helped.predicted_error, abs=1e-9)


def test_an_easy_step_never_asks_the_fallback() -> None:
    class Asked(Exception):
        pass

    class Refusing:
        @property
        def recipe(self) -> Recipe[CEM]:
            raise Asked

    taken = control_step(
        PLAIN,
        System(),
        Measurement(0.0, 0.1),
        Goal(0.3, 64),
        fallback=Refusing(),  # type: ignore[arg-type]
    )
    assert taken.predicted_error is not None
    assert taken.predicted_error < 1e-3


def test_over_an_ensemble_it_plans_for_all_of_its_plants() -> None:
    systems = [System(coulomb_friction=friction) for friction in (0.54, 0.6, 0.66)]
    ensemble = Ensemble.of(systems, np.zeros(2))
    measurement, goal = Measurement(0.0, 0.1), Goal(0.2, 64)
    many = replace(PLAIN, iterations=40)
    nominal = control_step(many, System(), measurement, goal)
    robust = control_step(many, System(), measurement, goal, ensemble=ensemble)

    here = Ensemble.of(systems, np.array([0.0, 0.1]))
    target = np.array([0.2, 0.0])
    of_nominal, of_robust = (
        float(np.mean(here.errors(taken.plan[np.newaxis], target) ** 2))
        for taken in (nominal, robust)
    )
    assert of_robust < 0.7 * of_nominal


def test_under_process_noise_and_pulses_it_arrives_all_the_same() -> None:
    looking = RecedingHorizon(observer=Observer(1e-3, 1e-2, acceleration_noise=0.1))
    runs = run(
        looking, truth=OFF, disturbance=Disturbance(0.1), sensor=Sensor(1e-3, 1e-2), seeds=10
    )

    assert runs.final_errors.max() < 0.01


def test_a_new_target_is_planned_for_at_once_however_seldom_plans_are_made() -> None:
    seldom = replace(PLAIN, replan_every=16)
    first = control_step(seldom, System(), Measurement(0.0, 0.2), Goal(0.3))
    second = control_step(seldom, System(), Measurement(0.01, 0.21), Goal(-0.3), first.memory)

    assert second.predicted_error is not None
    assert second.control < 0.0
