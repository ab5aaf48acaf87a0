"""What every controller keeps to: a new one is tested here by being registered."""

import json
from dataclasses import replace
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.control import CONTROLLERS, AnyController, RecedingHorizon
from app.planning.control.carry import read_carry, write_carry
from app.planning.control.memory import Memory
from app.planning.control.observer import Observer
from app.planning.control.runs import Runs
from app.planning.control.simulation import Disturbance, Pulse, Sensor
from app.planning.control.step import STATUSES, Goal, Measurement, control_step
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from tests.planning.control.controllers import EVERY_CONTROLLER, EXACT, OFF, run
from tests.planning.plants import machines, systems

every_controller = pytest.mark.parametrize(
    "controller", EVERY_CONTROLLER, ids=lambda controller: controller.name
)
NOISY = Sensor(1e-3, 1e-2)
ROUGH = Disturbance(0.1, (Pulse(40, 5, 1.5),))


def test_names_are_unique_and_the_registry_has_all_that_a_request_may_name() -> None:
    names = [get_args(get_type_hints(kind)["name"]) for kind in CONTROLLERS]

    assert names == [(kind().name,) for kind in CONTROLLERS]
    assert len(set(names)) == len(CONTROLLERS)
    assert set(get_args(AnyController)) == set(CONTROLLERS)


@every_controller
def test_it_comes_to_rest_near_the_target_of_a_plant_that_is_off(controller: AnyController) -> None:
    runs = run(controller)

    assert runs.final_errors[0] < 0.01
    assert runs.states[0, -1, 1] == 0.0
    assert not runs.hunting[0]


@every_controller
def test_the_same_seed_is_the_same_run_and_another_one_another(controller: AnyController) -> None:
    once, again = (run(controller, sensor=NOISY, disturbance=ROUGH, seeds=2) for _ in range(2))

    for one, other in zip(_arrays(once), _arrays(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(once.states[0], once.states[1])


@every_controller
@settings(max_examples=25)
@given(
    model=systems() | machines(),
    truth_gain=st.floats(0.5, 2.0),
    state=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    target=st.floats(-3, 3),
    deadline=st.none() | st.integers(0, 40),
    delay=st.integers(0, 2),
    observer=st.sampled_from([None, EXACT, Observer(1e-3), Observer(0.1, 1.0)]),
)
def test_controls_keep_to_the_limits_and_everything_is_finite_on_any_machine(
    controller: AnyController,
    model: System,
    truth_gain: float,
    state: tuple[float, float],
    target: float,
    deadline: int | None,
    delay: int,
    observer: Observer | None,
) -> None:
    runs = run(
        replace(controller, observer=observer),
        truth=replace(model, control_gain=truth_gain * model.control_gain),
        model=model,
        start=state,
        target=target,
        steps=40,
        deadline=deadline,
        disturbance=Disturbance(0.1),
        sensor=Sensor(1e-3, 1e-2),
        delay_steps=delay,
    )

    assert np.all(runs.controls >= model.plant.lowest_control)
    assert np.all(runs.controls <= model.plant.highest_control)
    assert np.all(np.isfinite(runs.states))
    assert np.all(np.isfinite(runs.estimates))
    assert set(np.unique(runs.statuses)) <= set(range(len(STATUSES)))


@every_controller
@pytest.mark.parametrize("observer", [None, EXACT], ids=["state", "observer"])
def test_it_holds_with_no_control_where_it_rests_in_the_dead_band(
    controller: AnyController, observer: Observer | None
) -> None:
    held = replace(controller, observer=observer, dead_band=1e-3)
    taken = control_step(held, System(), Measurement(0.2995, 0.0), Goal(0.3, 10))

    assert taken.control == 0.0
    assert taken.status == "arrived"


@every_controller
@pytest.mark.parametrize("deadline", [None, 30])
@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("observer", [None, EXACT, Observer(1e-3, 1e-2)])
def test_single_steps_with_what_a_client_carries_are_a_whole_run(
    controller: AnyController, deadline: int | None, delay: int, observer: Observer | None
) -> None:
    looking = replace(controller, observer=observer)
    steps = 50
    whole = run(looking, steps=steps, deadline=deadline, delay_steps=delay, sensor=NOISY)
    memory: Memory | None = None
    pending = [0.0] * delay
    for k in range(steps):
        measurement = Measurement(*whole.measurements[0, k].tolist())
        goal = Goal(0.3, None if deadline is None else deadline - k)
        taken = control_step(looking, System(), measurement, goal, memory, pending_controls=pending)
        assert taken.control == whole.controls[0, k]
        assert taken.status == STATUSES[whole.statuses[0, k]]
        memory = read_carry(json.loads(json.dumps(write_carry(taken.memory))))
        pending = [*pending, taken.control][1:] if delay else []


@every_controller
def test_a_step_changes_nothing_that_it_is_given(controller: AnyController) -> None:
    begun = control_step(controller, System(), Measurement(0.0, 0.1), Goal(0.3, 64)).memory
    before = begun.copy()
    control_step(controller, System(), Measurement(0.005, 0.1), Goal(0.3, 63), begun)

    for part, kept in zip(begun, before, strict=True):
        np.testing.assert_array_equal(part, kept)


@every_controller
def test_the_predicted_states_are_those_of_the_plan_after_the_pending_controls(
    controller: AnyController,
) -> None:
    looking = replace(controller, observer=None)
    pending = [0.9, 0.9]
    taken = control_step(
        looking, System(), Measurement(0.0, 0.1), Goal(0.3, 64), pending_controls=pending
    )

    start = rollout(System(), np.array([0.0, 0.1]), np.array([pending]))[0, -1]
    states = rollout(System(), start, taken.plan[np.newaxis])[0]
    np.testing.assert_allclose(taken.predicted_states, states)
    assert taken.plan[0] == taken.control
    assert len(taken.plan) == (64 if isinstance(controller, RecedingHorizon) else 1)


@every_controller
def test_without_velocities_and_observer_there_is_nothing_to_go_by(
    controller: AnyController,
) -> None:
    blind = replace(controller, observer=None)

    with pytest.raises(ValueError, match="observer"):
        control_step(blind, System(), Measurement(0.0), Goal(0.3))
    with pytest.raises(ValueError, match="observer"):
        run(blind, sensor=Sensor(measures_velocity=False))


@every_controller
@pytest.mark.parametrize("truth", [OFF, System(bias=0.1)], ids=["off", "biased"])
def test_positions_alone_are_enough(controller: AnyController, truth: System) -> None:
    looking = replace(controller, observer=Observer(1e-3), dead_band=4e-3)
    runs = run(looking, truth=truth, sensor=Sensor(1e-3, measures_velocity=False), seeds=5)

    assert np.all(runs.final_errors < 0.01)


def _arrays(runs: Runs) -> list[Any]:
    return [runs.states, runs.measurements, runs.estimates, runs.controls, runs.statuses]
