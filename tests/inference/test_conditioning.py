import numpy as np
import pytest

from app.inference.conditioning import FEATURES, Conditioning
from app.planning.problem import Problem

PROBLEM = Problem(np.array([0.3, -0.2]), np.array([0.7, 0.1]))


def test_the_papers_condition_is_start_and_target_standardised_in_double_precision() -> None:
    mean, std = np.array([0.0011, -0.00075]), np.array([0.61, 0.29])
    states = np.stack([PROBLEM.initial_state, PROBLEM.target_state])

    condition = Conditioning.on_states(mean.tolist(), std.tolist()).encode(PROBLEM)

    assert condition.dtype == np.float32
    np.testing.assert_array_equal(condition, ((states - mean) / std).ravel().astype(np.float32))


def test_features_are_taken_by_name_in_the_order_of_the_manifest() -> None:
    conditioning = Conditioning(
        features=("target_velocity", "initial_position"), mean=(0.0, 0.5), std=(1.0, 2.0)
    )

    assert conditioning.size == 2
    np.testing.assert_allclose(conditioning.encode(PROBLEM), [0.1, -0.1], rtol=1e-6)


@pytest.mark.parametrize("feature", FEATURES)
def test_every_feature_is_a_number_of_the_problem(feature: str) -> None:
    conditioning = Conditioning(features=(feature,), mean=(0.0,), std=(1.0,))

    assert conditioning.encode(PROBLEM)[0] == np.float32(FEATURES[feature](PROBLEM))


def test_many_conditions_are_standardised_at_once() -> None:
    conditioning = Conditioning.on_states((1.0, 0.0), (2.0, 4.0))

    np.testing.assert_array_equal(
        conditioning.standardise(np.array([[1.0, 2.0, 5.0, -2.0], [3.0, 0.0, 1.0, 0.0]])),
        [[0.0, 0.5, 2.0, -0.5], [1.0, 0.0, 0.0, 0.0]],
    )


def test_an_unknown_feature_is_refused_and_those_that_exist_are_named() -> None:
    with pytest.raises(ValueError, match=r"no features mass; there are: initial_position"):
        Conditioning(features=("mass",), mean=(0.0,), std=(1.0,))


@pytest.mark.parametrize(("mean", "std"), [((0.0, 0.0), (1.0,)), ((0.0,), ())])
def test_a_feature_without_mean_or_std_is_refused(
    mean: tuple[float, ...], std: tuple[float, ...]
) -> None:
    with pytest.raises(ValueError, match="equally many"):
        Conditioning(features=("initial_position",), mean=mean, std=std)
