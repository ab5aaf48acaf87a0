import numpy as np
import pytest

from app.planning.control import PD, RecedingHorizon
from app.planning.control.runs import Runs
from app.planning.control.simulation import (
    Controls,
    Disturbance,
    Pulse,
    Sensor,
    ToldOf,
    TrueMachine,
    simulate,
)
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from tests.planning.control.controllers import OFF, run
from tests.planning.fakes import assert_stops

PUSHES = np.random.default_rng(0).uniform(-0.9, 0.9, 40)


def test_the_open_loop_is_a_rollout_on_the_true_plant_and_then_holds() -> None:
    runs = run(Controls(PUSHES), steps=60)

    held = np.concatenate([PUSHES, np.zeros(20)])
    np.testing.assert_array_equal(runs.controls[0], held)
    np.testing.assert_array_equal(runs.states[0], rollout(OFF, np.zeros(2), held[np.newaxis])[0])


def test_a_delay_shifts_the_controls() -> None:
    late = run(Controls(PUSHES), steps=43, delay_steps=3)

    acting = np.concatenate([np.zeros(3), PUSHES])[np.newaxis]
    np.testing.assert_array_equal(late.states[0], rollout(OFF, np.zeros(2), acting)[0])


def test_a_pulse_pushes_as_its_acceleration_does() -> None:
    pulse = Disturbance(pulses=(Pulse(5, 3, 1.5),))
    runs = run(
        Controls(np.zeros(1)),
        truth=System(control_gain=2.0),
        model=System(control_gain=2.0),
        steps=20,
        disturbance=pulse,
    )

    pushed = np.zeros(20)
    pushed[5:8] = 1.5
    as_controls = rollout(System(), np.zeros(2), pushed[np.newaxis])[0]
    np.testing.assert_allclose(runs.states[0], as_controls, atol=1e-15)


def test_noise_is_drawn_anew_for_each_step_and_seed_with_its_standard_deviation() -> None:
    runs = run(Controls(np.zeros(1)), sensor=Sensor(0.02, 0.3), steps=400, seeds=5)
    errors = runs.measurements - runs.states

    assert np.all(runs.states == 0.0)
    np.testing.assert_allclose(errors.std(axis=(0, 1)), [0.02, 0.3], rtol=0.05)
    assert len(np.unique(errors[..., 0])) == 5 * 401


def test_process_noise_moves_a_frictionless_mass_as_a_random_walk_of_its_velocity() -> None:
    free = System(0.0, 0.0, 0.0, velocity_threshold=1e-6)
    runs = run(
        Controls(np.zeros(1)),
        truth=free,
        model=free,
        disturbance=Disturbance(0.2),
        seeds=400,
        steps=25,
    )

    assert runs.states[:, -1, 1].std() == pytest.approx(0.2 * 0.05 * 5, rel=0.1)


def test_an_encoder_rounds_positions_to_its_resolution() -> None:
    runs = run(RecedingHorizon(), sensor=Sensor(position_step=1e-3), steps=64)
    positions = runs.measurements[0, :, 0]

    np.testing.assert_allclose(positions, 1e-3 * np.round(positions / 1e-3), atol=1e-12)
    assert np.abs(positions - runs.states[0, :, 0]).max() <= 0.5e-3 + 1e-12


def test_velocities_that_are_not_measured_are_no_numbers() -> None:
    runs = run(RecedingHorizon(), sensor=Sensor(measures_velocity=False), steps=10)

    assert np.all(np.isnan(runs.measurements[..., 1]))
    assert np.all(np.isfinite(runs.estimates))


def test_all_controllers_meet_the_same_disturbances() -> None:
    one, other = (
        run(
            controller,
            sensor=Sensor(1e-3, 1e-2),
            disturbance=Disturbance(0.1),
            seeds=2,
            steps=5,
        )
        for controller in (RecedingHorizon(), PD())
    )

    np.testing.assert_allclose(
        one.measurements - one.states, other.measurements - other.states, atol=1e-15
    )


@pytest.mark.parametrize(
    ("model", "what"),
    [(System(time_step=0.02), "time_step"), (System(control_limit=0.8), "control_limit")],
)
def test_a_model_of_another_machine_is_refused(model: System, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        run(RecedingHorizon(), model=model)


def test_more_controls_than_a_plan_can_have_are_refused() -> None:
    with pytest.raises(ValueError, match="1024"):
        run(Controls(np.zeros(1025)))


def test_it_is_stopped_early() -> None:
    begun: list[bool] = []

    def seeds() -> object:
        begun.append(True)
        yield from range(10**9)

    assert_stops(
        lambda stop: simulate(
            TrueMachine(),
            (0.0, 0.0),
            RecedingHorizon(),
            ToldOf(System(), 0.3),
            1000,
            seeds(),  # type: ignore[arg-type]
            stop=stop,
        ),
        lambda: bool(begun),
    )


def test_the_measures_of_runs_are_what_they_say() -> None:
    states = np.zeros((3, 65, 2))
    states[0, :40, 0] = 1.0  # settles at step 40
    states[0, 20, 1] = 1.0
    states[1, -1, 0] = 0.02  # leaves with the last step
    states[2, -10:, 1] = 0.005  # creeps
    controls = np.full((3, 64), 0.5)
    runs = Runs(System(), 0.0, states, states, states[:, 1:], controls, np.zeros((3, 64), int))

    np.testing.assert_array_equal(runs.settling_steps, [40, 65, 0])
    np.testing.assert_allclose(runs.final_errors, [0.0, 0.02, 0.0])
    np.testing.assert_array_equal(runs.are_inside(20), [False, True, True])
    np.testing.assert_array_equal(runs.are_inside(64), [True, False, True])
    np.testing.assert_array_equal(runs.moving_steps, [0, 0, 10])
    np.testing.assert_array_equal(runs.hunting, [False, False, True])
    np.testing.assert_allclose(runs.energies, 16.0)
