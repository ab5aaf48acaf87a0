import numpy as np
import pytest

from app.inference.conditioning import Conditioning
from app.planning.plant.features import PLANT_FEATURES, TASK_FEATURES, feature_values
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from app.planning.problem import Problem

PROBLEM = Problem(np.array([0.3, -0.2]), np.array([0.7, 0.1]))


def test_the_papers_condition_is_start_and_target_standardised_in_double_precision() -> None:
    mean, std = np.array([0.0011, -0.00075]), np.array([0.61, 0.29])
    states = np.stack([PROBLEM.initial_state, PROBLEM.target_state])

    conditioning = Conditioning.on_states(mean.tolist(), std.tolist())
    (condition,) = conditioning.encode_tasks(PROBLEM.task, PROBLEM.horizon)

    assert condition.dtype == np.float32
    np.testing.assert_array_equal(condition, ((states - mean) / std).ravel().astype(np.float32))


def test_features_are_taken_by_name_in_the_order_of_the_manifest() -> None:
    conditioning = Conditioning(
        features=("target_velocity", "static_forward", "initial_position"),
        mean=(0.0, 0.2, 0.5),
        std=(1.0, 0.25, 2.0),
    )

    assert conditioning.size == 3
    np.testing.assert_allclose(
        conditioning.encode_tasks(PROBLEM.task, PROBLEM.horizon), [[0.1, 2, -0.1]], rtol=1e-6
    )


@pytest.mark.parametrize("feature", [*TASK_FEATURES, *PLANT_FEATURES])
def test_every_feature_may_be_part_of_a_condition(feature: str) -> None:
    conditioning = Conditioning(features=(feature,), mean=(0.0,), std=(1.0,))

    value = feature_values((feature,), PROBLEM.task, PROBLEM.horizon)
    assert conditioning.encode_tasks(PROBLEM.task, PROBLEM.horizon)[0, 0] == np.float32(value[0, 0])


def test_many_tasks_are_encoded_at_once_and_each_as_it_is_alone() -> None:
    features = (*TASK_FEATURES, *PLANT_FEATURES)
    conditioning = Conditioning(
        features=features, mean=(0.5,) * len(features), std=(3.0,) * len(features)
    )
    problems = [
        Problem(np.array([0.1, 0.2]), np.array([0.3, -0.1]), machine.system, 48)
        for machine in MACHINES.values()
    ]
    alone = np.stack([conditioning.encode_tasks(problem.task, 48)[0] for problem in problems])
    plants = Plant(*np.array([problem.task.plant for problem in problems]).T)

    together = conditioning.encode_tasks(Task(0.1, 0.2, 0.3, -0.1, plants), 48)

    assert together.shape == (len(MACHINES), len(features))
    assert together.dtype == np.float32
    np.testing.assert_allclose(together, alone, rtol=1e-6)


def test_an_unknown_feature_is_refused_and_those_that_exist_are_named() -> None:
    with pytest.raises(ValueError, match=r"no features mass; there are: initial_position"):
        Conditioning(features=("mass",), mean=(0.0,), std=(1.0,))


@pytest.mark.parametrize(("mean", "std"), [((0.0, 0.0), (1.0,)), ((0.0,), ())])
def test_a_feature_without_mean_or_std_is_refused(
    mean: tuple[float, ...], std: tuple[float, ...]
) -> None:
    with pytest.raises(ValueError, match="equally many"):
        Conditioning(features=("initial_position",), mean=mean, std=std)
