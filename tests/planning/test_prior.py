import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.plant.system import ControlLimits, Plant, System
from app.planning.prior import ControlPrior
from tests.planning.plants import plants

LIMIT = 0.9
fractions = st.floats(0, 1)


def draw(prior: ControlPrior, num_candidates: int, horizon: int, seed: int = 0) -> FloatArray:
    return prior.sample(num_candidates, horizon, System().plant, np.random.default_rng(seed))


def segment_values(num_candidates: int = 20_000) -> FloatArray:
    """Segment magnitudes of the default prior as fractions of the limit, before the filter."""
    return draw(ControlPrior(filter_coefficient=0.0), num_candidates, 8) / LIMIT


@given(
    kick=st.floats(0, 0.5),
    medium=st.floats(0, 0.5),
    kick_minimum=fractions,
    medium_maximum=fractions,
    near_zero_maximum=fractions,
    coefficient=fractions,
    plant=plants(),
)
@settings(max_examples=50)
def test_controls_lie_within_the_limits(
    kick: float,
    medium: float,
    kick_minimum: float,
    medium_maximum: float,
    near_zero_maximum: float,
    coefficient: float,
    plant: Plant,
) -> None:
    prior = ControlPrior(
        kick_probability=kick,
        medium_probability=medium,
        kick_minimum=kick_minimum,
        medium_maximum=medium_maximum,
        near_zero_maximum=near_zero_maximum,
        filter_coefficient=coefficient,
    )

    controls = prior.sample(20, 64, plant, np.random.default_rng(0))

    assert controls.shape == (20, 64)
    assert np.all((plant.lowest_control <= controls) & (controls <= plant.highest_control))


@pytest.mark.parametrize(
    ("num_segments", "horizon", "lengths"),
    [(8, 64, {8}), (8, 50, {6, 7}), (3, 7, {2, 3}), (1, 5, {5}), (8, 8, {1})],
)
def test_without_a_filter_there_are_as_many_constant_segments_as_asked_for(
    num_segments: int, horizon: int, lengths: set[int]
) -> None:
    prior = ControlPrior(num_segments=num_segments, filter_coefficient=0.0)

    for row in draw(prior, 50, horizon):
        jumps = np.flatnonzero(np.diff(row)) + 1
        assert len(jumps) == num_segments - 1
        assert set(np.diff([0, *jumps, horizon])) == lengths


def test_a_horizon_shorter_than_the_segments_gives_one_value_a_step() -> None:
    controls = draw(ControlPrior(num_segments=8, filter_coefficient=0.0), 50, 5)

    assert controls.shape == (50, 5)
    assert np.all(np.diff(controls) != 0)


@pytest.mark.parametrize("coefficient", [0.3, 0.9])
def test_the_filter_is_first_order_and_starts_at_the_first_segment(coefficient: float) -> None:
    horizon = 50
    raw = draw(ControlPrior(filter_coefficient=0.0), 20, horizon, seed=3)
    filtered = draw(ControlPrior(filter_coefficient=coefficient), 20, horizon, seed=3)

    # y[k] = alpha^(k+1) s[0] + sum over j <= k of (1-alpha) alpha^(k-j) s[j]
    k = np.arange(horizon)
    lag = k[:, None] - k[None, :]
    response = np.where(lag >= 0, (1 - coefficient) * coefficient ** np.maximum(lag, 0), 0.0)
    response[:, 0] += coefficient ** (k + 1)
    np.testing.assert_allclose(filtered, raw @ response.T, atol=1e-12)


def test_the_modes_come_as_often_as_configured() -> None:
    magnitude = np.abs(segment_values())

    # Medium values are uniform on [-0.6, 0.6]: a quarter of them lies within 0.15.
    assert np.mean(magnitude >= 0.75) == pytest.approx(0.4, abs=0.01)
    assert np.mean((magnitude > 0.15) & (magnitude <= 0.6)) == pytest.approx(0.3, abs=0.01)
    assert np.mean(magnitude <= 0.15) == pytest.approx(0.3, abs=0.01)
    assert not np.any((magnitude > 0.6) & (magnitude < 0.75))


def test_kicks_are_uniform_up_to_the_limit_in_both_directions() -> None:
    values = segment_values()
    kicks = values[np.abs(values) >= 0.75]

    assert np.mean(kicks > 0) == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(
        np.quantile(np.abs(kicks), [0, 0.25, 0.5, 0.75, 1]),
        [0.75, 0.8125, 0.875, 0.9375, 1.0],
        atol=0.003,
    )


@pytest.mark.parametrize(
    ("prior", "reach"),
    [
        (ControlPrior(kick_probability=0.0, medium_probability=1.0, filter_coefficient=0.0), 0.6),
        (ControlPrior(kick_probability=0.0, medium_probability=0.0, filter_coefficient=0.0), 0.15),
    ],
    ids=["medium", "near zero"],
)
def test_a_mode_on_its_own_is_uniform_about_zero(prior: ControlPrior, reach: float) -> None:
    values = draw(prior, 20_000, 8) / LIMIT

    np.testing.assert_allclose(
        np.quantile(values, [0, 0.25, 0.5, 0.75, 1]) / reach, [-1, -0.5, 0, 0.5, 1], atol=0.02
    )


def test_kicks_alone_leave_no_quiet_segment() -> None:
    prior = ControlPrior(kick_probability=1.0, medium_probability=0.0, filter_coefficient=0.0)

    assert np.all(np.abs(draw(prior, 500, 64)) >= 0.75 * LIMIT)


def test_segments_are_independent() -> None:
    correlations = np.corrcoef(segment_values().T)

    assert np.max(np.abs(correlations - np.eye(8))) < 0.03


def test_the_seed_decides_the_draws() -> None:
    prior = ControlPrior()

    np.testing.assert_array_equal(draw(prior, 10, 64, seed=7), draw(prior, 10, 64, seed=7))
    assert not np.array_equal(draw(prior, 10, 64, seed=7), draw(prior, 10, 64, seed=8))


def test_one_generator_goes_on_to_new_draws() -> None:
    rng = np.random.default_rng(0)

    first = ControlPrior().sample(10, 64, System().plant, rng)

    assert not np.array_equal(first, ControlPrior().sample(10, 64, System().plant, rng))


@pytest.mark.parametrize("limit", [0.5, 3.0])
def test_controls_scale_with_the_limit(limit: float) -> None:
    plant = System(control_limit=limit).plant
    controls = ControlPrior().sample(10, 64, plant, np.random.default_rng(0))

    np.testing.assert_allclose(controls / limit, draw(ControlPrior(), 10, 64) / LIMIT, atol=1e-12)


def test_each_side_scales_with_its_own_limit() -> None:
    lopsided = System(control_limit=ControlLimits(-0.2, 5.0)).plant

    controls = ControlPrior().sample(10, 64, lopsided, np.random.default_rng(0))

    fractions = draw(ControlPrior(), 10, 64) / LIMIT
    expected = np.where(fractions >= 0, 5.0, 0.2) * fractions
    np.testing.assert_allclose(controls, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"num_segments": 0}, "num_segments"),
        ({"num_segments": 1025}, "num_segments"),
        ({"kick_probability": -0.1}, "kick_probability"),
        ({"medium_probability": 1.1}, "medium_probability"),
        ({"kick_minimum": 1.1}, "kick_minimum"),
        ({"medium_maximum": -0.1}, "medium_maximum"),
        ({"near_zero_maximum": 2.0}, "near_zero_maximum"),
        ({"filter_coefficient": 1.01}, "filter_coefficient"),
        ({"filter_coefficient": float("nan")}, "filter_coefficient"),
        ({"kick_probability": 0.7, "medium_probability": 0.4}, "must not exceed 1"),
    ],
)
def test_an_impossible_prior_is_refused_by_the_name_of_its_option(
    options: dict[str, float], named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        ControlPrior(**options)  # type: ignore[arg-type]
