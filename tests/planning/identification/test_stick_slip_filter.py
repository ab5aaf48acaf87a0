"""The filter against the plant's own step, against brute force, and against the textbook."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.identification.measurement_update import update_position, update_velocity
from app.planning.identification.stick_slip_filter import Belief, Mode, mean_state, predict
from app.planning.plant.rollout import step
from app.planning.plant.system import Plant, System
from tests.planning.plants import plants

NOWHERE = Mode(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def at_rest(position: float, variance: float = 0.0) -> Belief:
    return Belief(Mode(1.0, position, 0.0, variance, 0.0, 0.0), NOWHERE)


def in_motion(position: float, velocity: float, deviations: tuple[float, float]) -> Belief:
    p, v = deviations
    return Belief(NOWHERE, Mode(1.0, position, velocity, p * p, 0.0, v * v))


@given(plants(), st.floats(-1, 1), st.floats(-2, 2), st.floats(-3, 3))
def test_without_noise_the_prediction_is_the_plants_own_step(
    plant: Plant, position: float, velocity: float, control: float
) -> None:
    belief = in_motion(position, velocity, (0.0, 0.0))
    predicted = mean_state(predict(belief, control, plant, 0.0))
    np.testing.assert_allclose(predicted, step(position, velocity, control, plant), atol=1e-12)


@given(plants(), st.floats(-3, 3))
def test_a_mass_at_rest_breaks_away_as_the_plant_says(plant: Plant, control: float) -> None:
    predicted = predict(at_rest(0.3), control, plant, 0.0)
    np.testing.assert_allclose(mean_state(predicted), step(0.3, 0.0, control, plant), atol=1e-12)


@compiled
def _push_many(states: FloatArray, control: float, pushes: FloatArray, plant: Plant) -> FloatArray:
    ends = np.empty_like(states)
    for i in range(len(states)):
        pushed = control + pushes[i] / plant.control_gain
        p, v = step(states[i, 0], states[i, 1], pushed, plant)
        ends[i, 0], ends[i, 1] = p, v
    return ends


@pytest.mark.parametrize("control", [0.62, 0.7, 0.75, -0.72])
def test_noise_at_break_away_moves_as_many_as_it_does_by_brute_force(control: float) -> None:
    plant, noise, rng = System().plant, 0.05, np.random.default_rng(0)
    states = np.zeros((200_000, 2))
    ends = _push_many(states, control, noise * rng.standard_normal(len(states)), plant)

    predicted = predict(at_rest(0.0), control, plant, noise)

    rests = ends[:, 1] == 0.0
    assert predicted.rest.probability == pytest.approx(rests.mean(), abs=0.005)
    moving = ends[~rests]
    assert predicted.sliding.velocity == pytest.approx(moving[:, 1].mean(), rel=0.02)
    assert predicted.sliding.velocity_variance == pytest.approx(moving[:, 1].var(), rel=0.05)


@pytest.mark.parametrize("velocity", [0.02, 0.04, -0.05])
def test_a_mass_that_may_stop_stops_as_often_as_by_brute_force(velocity: float) -> None:
    plant, noise, rng = System().plant, 0.1, np.random.default_rng(1)
    deviations = 1e-3, 0.01
    states = np.array([0.0, velocity]) + deviations * rng.standard_normal((200_000, 2))
    ends = _push_many(states, 0.0, noise * rng.standard_normal(len(states)), plant)

    predicted = predict(in_motion(0.0, velocity, deviations), 0.0, plant, noise)

    rests = ends[:, 1] == 0.0
    assert predicted.rest.probability == pytest.approx(rests.mean(), abs=0.01)
    for mode, group in ((predicted.rest, ends[rests]), (predicted.sliding, ends[~rests])):
        assert mode.position == pytest.approx(group[:, 0].mean(), abs=1e-4)
        assert mode.position_variance == pytest.approx(group[:, 0].var(), rel=0.1)


def test_a_measurement_weighs_as_kalman_has_it() -> None:
    covariance = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    belief = Belief(NOWHERE, Mode(1.0, 0.1, 0.2, 4e-4, 1e-4, 9e-4))
    lag = 0.025
    for update, more, seen, measured in (
        (update_position, (0.0,), np.array([1.0, 0.0]), 0.13),
        (update_position, (lag,), np.array([1.0, -lag]), 0.13),
        (update_velocity, (), np.array([0.0, 1.0]), 0.15),
    ):
        variance = seen @ covariance @ seen + 0.01**2
        gain = covariance @ seen / variance
        mean = np.array([0.1, 0.2]) + gain * (measured - seen @ [0.1, 0.2])
        left = covariance - np.outer(gain, seen @ covariance)

        after, log_likelihood = update(belief, measured, 0.01, *more)

        mode = after.sliding
        np.testing.assert_allclose([mode.position, mode.velocity], mean)
        np.testing.assert_allclose(
            [mode.position_variance, mode.covariance, mode.velocity_variance],
            [left[0, 0], left[0, 1], left[1, 1]],
        )
        innovation = measured - seen @ [0.1, 0.2]
        density = -0.5 * (np.log(2 * np.pi * variance) + innovation**2 / variance)
        assert log_likelihood == pytest.approx(density)


@given(
    plants(),
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-1, 1)), min_size=1, max_size=20),
    st.floats(0, 1),
)
def test_a_belief_stays_one_whatever_is_measured(
    plant: Plant, steps: list[tuple[float, float]], noise: float
) -> None:
    belief = Belief(Mode(0.5, 0.0, 0.0, 1e-6, 0.0, 0.0), Mode(0.5, 0.0, 0.1, 1e-6, 0.0, 1e-2))
    for control, measured in steps:
        belief = predict(belief, control, plant, noise)
        belief, log_likelihood = update_position(belief, measured, 1e-2, 0.025)
        rest, sliding = belief
        assert rest.probability + sliding.probability == pytest.approx(1.0)
        assert np.isfinite(log_likelihood)
        assert np.isfinite([*rest, *sliding]).all()
