"""The friction law: motions in closed form, what a step may do, and all that its controls reach."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.plant.friction import (
    BREAKING_AWAY,
    SLIDING,
    STOPPING,
    STUCK,
    Regime,
    Step,
    breaking_away,
    control_towards,
    counts_as_stuck,
    is_symmetric,
    sliding,
    take_step,
)
from app.planning.plant.rollout import rollout
from app.planning.plant.system import Plant, System
from tests.planning.plants import mirrored, plants, systems

UNDAMPED = System(viscous_damping=0.0)
"""Coasting loses exactly 0.03 m/s a step: f_c * dt."""
ROUNDING = 1e-12

velocities = st.floats(-2, 2)
velocities_near_rest = velocities | st.floats(-0.05, 0.05)
controls = st.floats(-4, 4)
control_lists = st.lists(st.floats(-2, 2), min_size=1, max_size=40)
shares = st.floats(0, 1)
directions = st.sampled_from([1.0, -1.0])


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


@given(
    speed=st.floats(0.01, 2),
    coulomb=st.floats(0.05, 2),
    time_step=st.floats(5e-3, 0.15),
    direction=directions,
)
def test_coulomb_friction_alone_stops_a_mass_after_its_stopping_distance(
    speed: float, coulomb: float, time_step: float, direction: float
) -> None:
    system = System(coulomb, coulomb, 0.0, time_step=time_step, velocity_threshold=1e-6)
    lost = coulomb * time_step
    sliding_steps = math.ceil(speed / lost)

    position, velocity = trajectory(system, 0.0, direction * speed, np.zeros(sliding_steps + 1))

    distance = direction * position[-1]
    left = speed - lost * np.arange(1, sliding_steps + 1)
    assert velocity[-1] == 0.0
    assert distance == pytest.approx(time_step * left.clip(0).sum(), abs=1e-6)
    # The textbook's, less what a step that moves with the velocity after friction falls short.
    assert distance == pytest.approx(
        speed**2 / (2 * coulomb) - time_step * speed / 2, abs=time_step * lost
    )


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


@given(plants(), velocities_near_rest, controls)
def test_a_mass_sticks_breaks_away_slides_or_stops(
    plant: Plant, velocity: float, control: float
) -> None:
    step = take_step(velocity, control, plant)

    if abs(velocity) >= plant.velocity_threshold:
        assert step.kind in {SLIDING, STOPPING}
        assert step.direction == math.copysign(1.0, velocity)
    elif abs(control) > plant.static_friction:
        assert step.kind == BREAKING_AWAY
        assert step.direction == math.copysign(1.0, control)
    else:
        assert step.kind == STUCK
        assert step.direction == 0.0
    if step.kind in {STUCK, STOPPING}:
        assert step.next_velocity == 0.0
    else:
        assert step.next_velocity == step.free_velocity


@given(plants(), velocities_near_rest, controls)
def test_what_counts_as_stuck_does_not_move(plant: Plant, velocity: float, control: float) -> None:
    is_stuck = take_step(velocity, control, plant).kind == STUCK

    assert counts_as_stuck(velocity, control, plant) == (
        is_stuck and abs(control) != plant.static_friction
    )


@given(plants(), velocities_near_rest, controls)
def test_the_derivatives_of_a_step_are_its_differences_away_from_the_switches(
    plant: Plant, velocity: float, control: float
) -> None:
    nudge = 1e-4
    step = take_step(velocity, control, plant)
    faster, slower = (take_step(velocity + by, control, plant) for by in (nudge, -nudge))
    harder, softer = (take_step(velocity, control + by, plant) for by in (nudge, -nudge))
    assume({(s.kind, s.direction) for s in (step, faster, slower, harder, softer)} == {step[:2]})

    for high, low, derivative in (
        (faster, slower, step.by_velocity),
        (harder, softer, step.by_control),
    ):
        difference = (high.next_velocity - low.next_velocity) / (2 * nudge)
        assert derivative == pytest.approx(difference, abs=1e-9)


@given(plants(), velocities_near_rest, controls)
def test_a_mirrored_step_is_the_mirror_image(plant: Plant, velocity: float, control: float) -> None:
    step = take_step(velocity, control, plant)

    assert take_step(-velocity, -control, mirrored(plant)) == step._replace(
        direction=-step.direction,
        free_velocity=-step.free_velocity,
        next_velocity=-step.next_velocity,
    )


def regime_of(step: Step, plant: Plant) -> Regime:
    """Return the regime that a step of a mass that moves belongs to."""
    regime = breaking_away if step.kind == BREAKING_AWAY else sliding
    return regime(step.direction, plant)


@given(plants(), velocities_near_rest, shares)
def test_every_step_of_a_mass_that_moves_ends_within_its_regime(
    plant: Plant, velocity: float, share: float
) -> None:
    lowest, highest = plant.lowest_control, plant.highest_control
    control = min(highest, lowest + share * (highest - lowest))
    step = take_step(velocity, control, plant)
    assume(step.kind != STUCK)

    regime = regime_of(step, plant)
    gained = step.free_velocity - regime.retained * velocity
    assert regime.low - ROUNDING <= gained <= regime.high + ROUNDING


@given(plants(), velocities_near_rest, directions)
def test_the_ends_of_a_regime_belong_to_the_extreme_controls(
    plant: Plant, velocity: float, direction: float
) -> None:
    limits = plant.highest_control, plant.lowest_control
    hardest, softest = limits if direction > 0 else reversed(limits)
    at_rest = abs(velocity) < plant.velocity_threshold
    if at_rest:
        # Whatever exceeds static friction moves the mass, unless all controls do.
        softest = max(direction * softest, math.nextafter(plant.static_friction, math.inf))
        softest *= direction
        regime = breaking_away(direction, plant)
    else:
        velocity = math.copysign(velocity, direction)
        regime = sliding(direction, plant)
    if at_rest and direction * hardest <= plant.static_friction:
        assert regime.low > regime.high
        return

    fastest, slowest = (take_step(velocity, u, plant) for u in (hardest, softest))
    ends = [step.free_velocity - regime.retained * velocity for step in (fastest, slowest)]
    assert sorted(ends) == pytest.approx([regime.low, regime.high], abs=ROUNDING)
    assert direction * ends[0] >= direction * ends[1]


@given(plants(), velocities_near_rest, directions, shares)
def test_every_velocity_of_a_regime_is_reached_by_some_control(
    plant: Plant, velocity: float, direction: float, share: float
) -> None:
    at_rest = abs(velocity) < plant.velocity_threshold
    if not at_rest:
        velocity = math.copysign(velocity, direction)
    regime = (breaking_away if at_rest else sliding)(direction, plant)
    assume(regime.low < regime.high)
    free = regime.retained * velocity + regime.low + share * (regime.high - regime.low)
    drag = 0.0 if at_rest else plant.viscous_damping * velocity
    control = (free - velocity) / plant.time_step + direction * plant.coulomb_friction + drag

    assert plant.lowest_control - 1e-9 <= control <= plant.highest_control + 1e-9
    # The slow end of breaking away is a limit that is not attained.
    assume(not at_rest or direction * control > plant.static_friction)
    assert take_step(velocity, control, plant).free_velocity == pytest.approx(free, abs=ROUNDING)


@given(plants(), directions)
def test_the_regimes_of_a_mirrored_plant_are_the_mirror_images(
    plant: Plant, direction: float
) -> None:
    for regime in (breaking_away, sliding):
        retained, low, high = regime(direction, plant)
        assert regime(-direction, mirrored(plant)) == (retained, -high, -low)
    assert is_symmetric(plant) == (mirrored(plant) == plant)
    assert is_symmetric(plant._replace(lowest_control=-2.0, highest_control=2.0))


@given(velocity=velocities_near_rest, control=controls, system=systems())
def test_the_control_towards_what_a_step_does_does_it_again(
    velocity: float, control: float, system: System
) -> None:
    plant = system.plant
    control = min(plant.highest_control, max(plant.lowest_control, control))
    after = take_step(velocity, control, plant).next_velocity

    again = control_towards(after, velocity, plant)

    assert plant.lowest_control <= again <= plant.highest_control
    assert take_step(velocity, again, plant).next_velocity == pytest.approx(after, abs=1e-9)
