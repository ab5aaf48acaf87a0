"""The friction law: motions in closed form, what a step may do, and all that its controls reach."""

import math
from dataclasses import replace
from functools import partial
from typing import Any

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
    breakaway_controls,
    breaking_away,
    can_rest,
    control_towards,
    counts_as_stuck,
    holding_control,
    is_symmetric,
    kept_velocity,
    resting_controls,
    sliding,
    take_step,
    velocity_that_keeps,
)
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, ControlLimits, Plant, System
from tests.planning.plants import machines, mirrored, plants, systems

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


@given(systems() | machines(), st.floats(-1, 1), velocities, control_lists)
def test_the_mirrored_start_and_input_give_the_mirrored_motion_of_the_mirrored_plant(
    system: System, position: float, velocity: float, controls: list[float]
) -> None:
    start, inputs = np.array([position, velocity]), np.array([controls])

    image = rollout(mirrored(system), -start, -inputs)
    np.testing.assert_array_equal(image, -rollout(system, start, inputs))


@pytest.mark.parametrize("bias", [0.7, -0.5])
def test_a_block_on_a_slope_holds_as_long_as_static_friction_carries_it(bias: float) -> None:
    static = ByDirection(0.7, 0.5)
    slope = System(static, 0.3, 0.0, bias=bias)
    steeper = replace(slope, bias=math.nextafter(bias, math.copysign(9, bias)))

    position, velocity = trajectory(slope, 0.25, 0.0, [0.0] * 20)
    assert np.all(position == 0.25)
    assert np.all(velocity == 0.0)

    k = np.arange(21)
    position, velocity = trajectory(steeper, 0.25, 0.0, [0.0] * 20)
    acceleration = bias - math.copysign(0.3, bias)
    np.testing.assert_allclose(velocity, 0.05 * acceleration * k, rtol=1e-12)
    np.testing.assert_allclose(
        position, 0.25 + 0.05**2 * acceleration * k * (k + 1) / 2, rtol=1e-12
    )


@pytest.mark.parametrize(("direction", "coulomb"), [(1.0, 0.2), (-1.0, 0.5)])
def test_a_mass_stops_after_another_distance_each_way(direction: float, coulomb: float) -> None:
    system = System(0.6, ByDirection(0.2, 0.5), 0.0, time_step=0.001, velocity_threshold=1e-6)

    position, velocity = trajectory(system, 0.0, direction * 0.4, [0.0] * 2001)

    assert velocity[-1] == 0.0
    # The textbook's v^2/2a, less what a step that moves with the velocity after it falls short.
    assert direction * position[-1] == pytest.approx(0.4**2 / (2 * coulomb) - 0.0002, abs=1e-6)


@pytest.mark.parametrize(("direction", "damping"), [(1.0, 0.4), (-1.0, 2.0)])
def test_a_mass_coasts_with_the_damping_of_its_direction(direction: float, damping: float) -> None:
    system = System(0.0, 0.0, ByDirection(0.4, 2.0), velocity_threshold=1e-6)

    _, velocity = trajectory(system, 0.0, direction, [0.0] * 20)

    decay = 1 - damping * 0.05
    np.testing.assert_allclose(velocity, direction * decay ** np.arange(21), rtol=1e-12)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_friction_falls_from_static_to_coulomb_as_stribeck_has_it(direction: float) -> None:
    system = System(1.2, 0.4, 0.0, stribeck_velocity=0.1, control_limit=9.0)

    for speed, friction in ((1e-3, 1.2), (0.1, 0.4 + 0.8 * math.exp(-1)), (0.7, 0.4)):
        _, velocity = trajectory(system, 0.0, direction * speed, [direction * 5.0])
        gained = 0.05 * (5.0 - friction)
        assert direction * velocity[1] == pytest.approx(speed + gained, abs=1e-5)
    # It breaks away against static friction, with no jump of the acceleration.
    _, velocity = trajectory(system, 0.0, 0.0, [direction * 1.2, direction * 1.21])
    assert direction * velocity == pytest.approx([0.0, 0.0, 0.05 * 0.01], abs=1e-12)


def test_an_acceleration_is_the_gain_times_the_control_and_the_bias() -> None:
    machine = System(0.0, 0.0, 0.0, bias=-0.2, control_gain=3.0)

    _, velocity = trajectory(machine, 0.0, 1.0, [0.5])

    assert velocity[1] == pytest.approx(1.0 + 0.05 * (3.0 * 0.5 - 0.2))


@given(systems() | machines(), st.floats(-1, 1), velocities, control_lists, st.integers(0, 6))
def test_other_units_of_control_and_length_give_the_same_motion(
    system: System, position: float, velocity: float, controls: list[float], power: int
) -> None:
    """By powers of two, with which no digit is lost."""
    factor = 2.0**power
    start, inputs = np.array([position, velocity]), np.array([controls])
    other_controls = replace(system, control_gain=system.control_gain / factor)
    plant = system.plant
    longer = replace(
        system,
        static_friction=ByDirection(factor * plant.static_forward, factor * plant.static_backward),
        coulomb_friction=ByDirection(
            factor * plant.coulomb_forward, factor * plant.coulomb_backward
        ),
        stribeck_velocity=system.stribeck_velocity and factor * system.stribeck_velocity,
        bias=factor * system.bias,
        control_gain=factor * system.control_gain,
        velocity_threshold=factor * system.velocity_threshold,
    )

    states = rollout(system, start, inputs)

    # But of numbers so small that they have fewer digits.
    same = partial(np.testing.assert_allclose, rtol=0, atol=np.finfo(np.float64).tiny)
    same(rollout(other_controls, start, factor * inputs), states)
    same(rollout(longer, factor * start, inputs), factor * states)


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
        {"stribeck_velocity": 0.1},
        {"bias": 0.01},
        {"control_gain": 1.01},
    ],
    ids=lambda change: next(iter(change)),
)
def test_every_parameter_of_the_motion_matters(change: dict[str, Any]) -> None:
    start, controls = np.zeros(2), np.array([[0.75, 0.75, 0.0, 0.0, 0.9, 0.9, 0.9]])

    usual = rollout(System(), start, controls)
    changed = rollout(replace(System(), **change), start, controls)

    assert not np.array_equal(usual, changed)


def push(control: float, plant: Plant) -> float:
    """Return the acceleration that is left to friction, m/s^2."""
    return plant.control_gain * control + plant.bias


@given(plants(), velocities_near_rest, controls)
def test_a_mass_sticks_breaks_away_slides_or_stops(
    plant: Plant, velocity: float, control: float
) -> None:
    step = take_step(velocity, control, plant)

    if abs(velocity) >= plant.velocity_threshold:
        assert step.kind in {SLIDING, STOPPING}
        assert step.direction == math.copysign(1.0, velocity)
    elif not -plant.static_backward <= push(control, plant) <= plant.static_forward:
        assert step.kind == BREAKING_AWAY
        assert step.direction == math.copysign(1.0, push(control, plant))
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

    at_the_edge = push(control, plant) in (plant.static_forward, -plant.static_backward)
    assert counts_as_stuck(velocity, control, plant) == (is_stuck and not at_the_edge)


@given(plants(), velocities_near_rest, controls)
def test_the_derivatives_of_a_step_are_its_differences_away_from_the_switches(
    plant: Plant, velocity: float, control: float
) -> None:
    nudge = 1e-7
    step = take_step(velocity, control, plant)
    faster, slower = (take_step(velocity + by, control, plant) for by in (nudge, -nudge))
    harder, softer = (take_step(velocity, control + by, plant) for by in (nudge, -nudge))
    assume({(s.kind, s.direction) for s in (step, faster, slower, harder, softer)} == {step[:2]})

    for high, low, derivative in (
        (faster, slower, step.by_velocity),
        (harder, softer, step.by_control),
    ):
        difference = (high.next_velocity - low.next_velocity) / (2 * nudge)
        assert derivative == pytest.approx(difference, rel=1e-5, abs=1e-6)


@given(systems() | machines(), velocities_near_rest, controls)
def test_a_mirrored_step_is_the_mirror_image(
    system: System, velocity: float, control: float
) -> None:
    step = take_step(velocity, control, system.plant)

    assert take_step(-velocity, -control, mirrored(system).plant) == step._replace(
        direction=-step.direction,
        free_velocity=-step.free_velocity,
        next_velocity=-step.next_velocity,
    )


def kept_by(step: Step, velocity: float, plant: Plant) -> float:
    """Return what a step of a mass that moves keeps of its velocity."""
    if step.kind == BREAKING_AWAY:
        return velocity
    return kept_velocity(velocity, step.direction, plant)


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
    gained = step.free_velocity - kept_by(step, velocity, plant)
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
        least = breakaway_controls(plant)
        softest = max(softest, least.high) if direction > 0 else min(softest, least.low)
        regime = breaking_away(direction, plant)
    else:
        velocity = math.copysign(velocity, direction)
        regime = sliding(direction, plant)
    if at_rest and direction * hardest < direction * softest:
        assert regime.low > regime.high
        return

    fastest, slowest = (take_step(velocity, u, plant) for u in (hardest, softest))
    ends = [step.free_velocity - kept_by(step, velocity, plant) for step in (fastest, slowest)]
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
    kept = velocity if at_rest else kept_velocity(velocity, direction, plant)
    free = kept + regime.low + share * (regime.high - regime.low)
    # A sliding mass that is to stop stops with more than it takes.
    assume(at_rest or direction * free > 0.0)

    control = control_towards(free, velocity, plant)

    assert plant.lowest_control <= control <= plant.highest_control
    assert take_step(velocity, control, plant).free_velocity == pytest.approx(free, abs=1e-9)


@given(plants(), st.floats(1e-6, 3), directions)
def test_the_velocity_that_keeps_what_another_one_keeps_is_that_one(
    plant: Plant, speed: float, direction: float
) -> None:
    kept = kept_velocity(direction * speed, direction, plant)

    assert velocity_that_keeps(kept, direction, plant) == pytest.approx(direction * speed, rel=1e-7)
    assert kept_velocity(direction * speed * 1.01, direction, plant) * direction > kept * direction


@given(plants())
def test_resting_controls_are_all_that_leave_a_mass_at_rest(plant: Plant) -> None:
    resting, breakaway = resting_controls(plant), breakaway_controls(plant)

    if resting.low <= resting.high:
        for control in (resting.low, resting.high, 0.5 * (resting.low + resting.high)):
            assert take_step(0.0, control, plant).kind == STUCK
    for direction, beyond in zip((-1.0, 1.0), breakaway, strict=True):
        step = take_step(0.0, beyond, plant)
        assert (step.kind, step.direction) == (BREAKING_AWAY, direction)
    largest = max(plant.static_forward, plant.static_backward, abs(plant.bias))
    rounding = 1e-14 * largest / plant.control_gain + 1e-300
    np.testing.assert_allclose(breakaway, resting, rtol=1e-14, atol=rounding)


@pytest.mark.parametrize("bias", [0.7, 0.1 + 0.2, -0.7, 1e6])
@pytest.mark.parametrize("gain", [1.0, 0.3694, 1e-6, 1e6])
def test_the_edge_of_rest_is_found_where_a_bias_takes_the_digits(bias: float, gain: float) -> None:
    plant = System(bias=bias, control_gain=gain).plant

    assert take_step(0.0, resting_controls(plant).high, plant).kind == STUCK
    assert take_step(0.0, breakaway_controls(plant).high, plant).direction == 1.0


@given(plants(), shares)
def test_a_mass_that_can_rest_rests_with_the_least_control(plant: Plant, share: float) -> None:
    resting = resting_controls(plant)
    # Without static friction there may be no number that balances the bias to the last bit.
    assume(resting.low <= resting.high)
    lowest, highest = plant.lowest_control, plant.highest_control
    holding = holding_control(plant)
    other = min(highest, lowest + share * (highest - lowest))

    assert lowest <= holding <= highest
    if can_rest(plant):
        assert take_step(0.0, holding, plant).kind == STUCK
    if take_step(0.0, other, plant).kind == STUCK:
        assert can_rest(plant)
        assert abs(holding) <= abs(other)


@given(systems() | machines(), directions)
def test_the_regimes_of_a_mirrored_plant_are_the_mirror_images(
    system: System, direction: float
) -> None:
    image = mirrored(system).plant
    for regime in (breaking_away, sliding):
        retained, low, high = regime(direction, system.plant)
        assert regime(-direction, image) == (retained, -high, -low)
    assert is_symmetric(system.plant) == is_symmetric(image)


@given(systems())
def test_a_plant_is_symmetric_if_nothing_of_it_has_a_direction(system: System) -> None:
    assert is_symmetric(system.plant)
    for part in (
        {"bias": 0.1},
        {"control_limit": ControlLimits(-0.9, 1.0)},
        {"static_friction": ByDirection(3.0, 3.1)},
        {"viscous_damping": ByDirection(0.1, 0.2)},
        {"static_friction": 3.0, "coulomb_friction": ByDirection(0.1, 0.2)},
    ):
        assert not is_symmetric(replace(system, **part).plant)
    # A bias that the limits make up for.
    tilted = ControlLimits(-1.5, 0.5)
    assert is_symmetric(replace(system, bias=0.5, control_limit=tilted).plant)


@given(velocity=velocities_near_rest, control=controls, system=systems() | machines())
def test_the_control_towards_what_a_step_does_does_it_again(
    velocity: float, control: float, system: System
) -> None:
    plant = system.plant
    control = min(plant.highest_control, max(plant.lowest_control, control))
    after = take_step(velocity, control, plant).next_velocity
    # A push too small to change the velocity tells no direction.
    assume(after == 0.0 or abs(after - velocity) > ROUNDING)

    again = control_towards(after, velocity, plant)

    assert plant.lowest_control <= again <= plant.highest_control
    assert take_step(velocity, again, plant).next_velocity == pytest.approx(after, abs=1e-9)
