import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System

UNDAMPED = System(viscous_damping=0.0)
"""Coasting loses exactly 0.03 m/s a step: f_c * dt."""

velocities = st.floats(-2, 2)
control_lists = st.lists(st.floats(-2, 2), min_size=1, max_size=40)


@st.composite
def systems(draw: st.DrawFn) -> System:
    static_friction = draw(st.floats(0, 2))
    return System(
        static_friction=static_friction,
        coulomb_friction=static_friction * draw(st.floats(0, 1)),
        viscous_damping=draw(st.floats(0, 5)),
        time_step=draw(st.floats(1e-3, 0.15)),
        velocity_threshold=draw(st.floats(1e-6, 0.05)),
    )


def trajectory(
    system: System, position: float, velocity: float, controls: list[float] | FloatArray
) -> tuple[FloatArray, FloatArray]:
    states = rollout(system, np.array([position, velocity]), np.array([controls]))[0]
    return states[:, 0], states[:, 1]


@pytest.mark.parametrize("control", [0.9, -0.75])
def test_a_constant_input_without_damping_gives_the_closed_form(control: float) -> None:
    acceleration = control - math.copysign(0.6, control)
    k = np.arange(65)

    position, velocity = trajectory(UNDAMPED, 0.3, 0.0, [control] * 64)

    np.testing.assert_allclose(velocity, 0.05 * acceleration * k, rtol=1e-12)
    # The position moves with the velocity after friction: sum of 1 ... k, not of 0 ... k-1.
    np.testing.assert_allclose(position, 0.3 + 0.05**2 * acceleration * k * (k + 1) / 2, rtol=1e-12)


@pytest.mark.parametrize("control", [0.9, -0.75])
def test_a_constant_input_with_damping_gives_the_closed_form(control: float) -> None:
    acceleration = control - math.copysign(0.6, control)
    decay = 1 - 0.4 * 0.05
    k = np.arange(65)

    position, velocity = trajectory(System(viscous_damping=0.4), 0.0, 0.0, [control] * 64)

    final_velocity = acceleration / 0.4
    np.testing.assert_allclose(velocity, final_velocity * (1 - decay**k), rtol=1e-12)
    np.testing.assert_allclose(
        position,
        0.05 * final_velocity * (k - decay * (1 - decay**k) / (1 - decay)),
        rtol=1e-11,
        atol=1e-15,
    )


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_coasting_mass_comes_to_exact_rest_and_stays_there(direction: float) -> None:
    position, velocity = trajectory(UNDAMPED, 0.0, direction * 0.5, np.zeros(64))

    k = np.arange(17)
    np.testing.assert_allclose(velocity[:17], direction * (0.5 - 0.03 * k), rtol=1e-12)
    np.testing.assert_allclose(
        position[:17], direction * 0.05 * (0.5 * k - 0.03 * k * (k + 1) / 2), rtol=1e-12
    )
    # 0.02 m/s are left, which the seventeenth step would turn into -0.01.
    assert np.all(velocity[17:] == 0.0)
    assert np.all(position[17:] == position[16])


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_mass_at_rest_moves_only_above_static_friction(direction: float) -> None:
    held, moved = 0.7, math.nextafter(0.7, 1.0)

    held_position, held_velocity = trajectory(System(), 0.25, 0.0, [direction * held] * 20)
    assert np.all(held_position == 0.25)
    assert np.all(held_velocity == 0.0)

    position, velocity = trajectory(System(), 0.25, 0.0, [direction * moved] * 20)
    assert np.all(np.diff(direction * position) > 0)
    assert direction * velocity[1] == pytest.approx(0.05 * 0.1)


def test_a_sliding_mass_needs_only_coulomb_friction_to_keep_going() -> None:
    _, velocity = trajectory(UNDAMPED, 0.0, 0.2, [0.65] * 10)

    np.testing.assert_allclose(velocity, 0.2 + 0.05 * 0.05 * np.arange(11), rtol=1e-12)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_step_that_would_reverse_the_mass_stops_it_where_it_is(direction: float) -> None:
    position, velocity = trajectory(
        System(), 0.4, direction * 0.01, [direction * -0.9, direction * -0.9]
    )

    assert velocity[1] == 0.0
    assert position[1] == 0.4
    # From rest the same input then breaks it away in its own direction.
    assert direction * velocity[2] == pytest.approx(-0.05 * 0.3)


def test_a_braking_step_that_does_not_reverse_the_mass_leaves_it_moving() -> None:
    position, velocity = trajectory(UNDAMPED, 0.0, 0.08, [-0.9])

    assert velocity[1] == pytest.approx(0.08 - 0.05 * 1.5)
    assert position[1] == pytest.approx(0.05 * velocity[1])


@pytest.mark.parametrize("velocity", [0.00099, -0.00099])
@pytest.mark.parametrize("control", [0.7, -0.7, 0.0])
def test_a_creeping_mass_below_the_threshold_is_put_to_exact_rest(
    velocity: float, control: float
) -> None:
    positions, velocities = trajectory(System(), 0.1, velocity, [control])

    assert velocities[1] == 0.0
    assert positions[1] == 0.1


def test_a_mass_at_the_velocity_threshold_slides() -> None:
    _, velocity = trajectory(UNDAMPED, 0.0, 1e-3, [0.65])

    assert velocity[1] == pytest.approx(1e-3 + 0.05 * 0.05)


def test_friction_on_a_creeping_mass_opposes_the_input() -> None:
    _, velocity = trajectory(System(), 0.0, 0.0005, [-0.9])

    assert velocity[1] == pytest.approx(0.0005 - 0.05 * 0.3)


@given(systems(), st.floats(-1, 1), velocities, control_lists)
def test_the_mirrored_start_and_input_give_the_mirrored_motion(
    system: System, position: float, velocity: float, controls: list[float]
) -> None:
    start, inputs = np.array([position, velocity]), np.array([controls])

    np.testing.assert_array_equal(rollout(system, -start, -inputs), -rollout(system, start, inputs))


@given(systems(), velocities)
def test_kinetic_energy_never_grows_without_input(system: System, velocity: float) -> None:
    _, velocities = trajectory(system, 0.0, velocity, np.zeros(60))

    assert np.all(np.diff(np.abs(velocities)) <= 0)


@given(systems(), velocities, control_lists)
def test_friction_alone_never_reverses_the_motion(
    system: System, velocity: float, controls: list[float]
) -> None:
    _, velocities = trajectory(system, 0.0, velocity, controls)

    # A mass that slides one way and next slides the other way was at rest in between.
    sliding = np.abs(velocities[:-1]) >= system.velocity_threshold
    assert np.all(velocities[1:][sliding] * velocities[:-1][sliding] >= 0)


@pytest.mark.parametrize(
    "change",
    [
        {"static_friction": 0.8},
        {"coulomb_friction": 0.5},
        {"viscous_damping": 0.1},
        {"time_step": 0.04},
        {"velocity_threshold": 0.02},
    ],
    ids=lambda change: next(iter(change)),
)
def test_every_parameter_of_the_motion_matters(change: dict[str, float]) -> None:
    start, controls = np.zeros(2), np.array([[0.75, 0.75, 0.0, 0.0, 0.9, 0.9, 0.9]])

    usual = rollout(System(), start, controls)
    changed = rollout(replace(System(), **change), start, controls)

    assert not np.array_equal(usual, changed)


def test_a_rollout_begins_with_the_initial_state_and_has_one_state_more_than_controls() -> None:
    start = np.array([0.3, -0.2])

    states = rollout(System(), start, np.zeros((5, 7)))

    assert states.shape == (5, 8, 2)
    assert states.dtype == np.float64
    assert np.all(states[:, 0] == start)


def test_one_start_for_all_rows_equals_that_start_row_by_row() -> None:
    rng = np.random.default_rng(0)
    controls = rng.uniform(-0.9, 0.9, (6, 64))
    start = np.array([0.3, -0.2])

    together = rollout(System(), start, controls)

    np.testing.assert_array_equal(together, rollout(System(), np.tile(start, (6, 1)), controls))
    for row in range(6):
        np.testing.assert_array_equal(
            together[row], rollout(System(), start, controls[row : row + 1])[0]
        )


def test_each_row_starts_from_its_own_state() -> None:
    rng = np.random.default_rng(1)
    controls = rng.uniform(-0.9, 0.9, (6, 64))
    starts = rng.uniform(-1, 1, (6, 2))

    states = rollout(System(), starts, controls)

    for row in range(6):
        np.testing.assert_array_equal(
            states[row], rollout(System(), starts[row], controls[row : row + 1])[0]
        )


def test_a_rollout_takes_strided_and_single_precision_controls() -> None:
    controls = np.random.default_rng(2).uniform(-0.9, 0.9, (64, 6)).astype(np.float32)

    np.testing.assert_array_equal(
        rollout(System(), np.zeros(2), controls.T),  # type: ignore[arg-type]
        rollout(System(), np.zeros(2), np.array(controls.T, dtype=np.float64)),
    )


@pytest.mark.parametrize(
    ("parameters", "named"),
    [
        ({"static_friction": -0.1, "coulomb_friction": -0.2}, "static_friction"),
        ({"coulomb_friction": -0.1}, "coulomb_friction"),
        ({"viscous_damping": -0.1}, "viscous_damping"),
        ({"control_limit": 0.0}, "control_limit"),
        ({"time_step": 0.0}, "time_step"),
        ({"velocity_threshold": 0.0}, "velocity_threshold"),
        ({"coulomb_friction": 0.71}, "coulomb_friction must not exceed static_friction"),
        ({"viscous_damping": 20.0}, "viscous_damping"),
        *(
            ({name: value}, name)
            for name in System.__dataclass_fields__
            for value in (math.nan, math.inf, -math.inf)
        ),
    ],
)
def test_an_impossible_plant_is_refused_by_the_name_of_its_parameter(
    parameters: dict[str, float], named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        System(**parameters)


def test_the_limits_of_what_is_possible_are_accepted() -> None:
    System(static_friction=0.0, coulomb_friction=0.0, viscous_damping=0.0)
    System(static_friction=0.6, coulomb_friction=0.6)
    System(viscous_damping=19.99)


def test_the_default_plant_is_that_of_the_paper() -> None:
    assert System().parameters == (0.7, 0.6, 0.05, 0.9, 0.05, 1e-3)
