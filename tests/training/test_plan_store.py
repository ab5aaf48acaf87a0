"""Plans on disk: made once, the same whoever makes them."""

from pathlib import Path

import numpy as np
import pytest

from tests.training.conftest import ANY_MACHINE, PLANS, Configure
from training.config import PlansConfig, TrainingConfig
from training.plan_store import PlanStore
from training.streams import Stream

ROBUST = ANY_MACHINE | {
    "data": PLANS
    | {
        "experts": PLANS["experts"]
        | {"rollout": 0.0, "margin": 0.0, "robust": 0.6, "num_motions": 16}
    }
}


@pytest.fixture(scope="module")
def config(configure: Configure) -> TrainingConfig:
    return configure(**ROBUST)


def store_of(config: TrainingConfig, parent: Path) -> PlanStore:
    assert isinstance(config.data, PlansConfig)
    return PlanStore(config, config.data, parent)


def test_a_chunk_is_the_same_made_kept_or_made_in_processes(
    config: TrainingConfig, tmp_path: Path
) -> None:
    made = store_of(config, tmp_path / "a").chunk(Stream.TRAINING_DATA, 1, 5)
    kept = store_of(config, tmp_path / "a").chunk(Stream.TRAINING_DATA, 1, 5)
    beside = store_of(config, tmp_path / "b")
    beside.make(Stream.TRAINING_DATA, range(3), 5, processes=2)
    files = sorted(tmp_path.glob("b/*/*.npz"))
    times = [file.stat().st_mtime_ns for file in files]
    beside.make(Stream.TRAINING_DATA, range(3), 5, processes=2)

    assert len(files) == 3
    assert [file.stat().st_mtime_ns for file in files] == times
    for other in (kept, beside.chunk(Stream.TRAINING_DATA, 1, 5)):
        np.testing.assert_array_equal(other.controls, made.controls)
        np.testing.assert_array_equal(other.tasks.states, made.tasks.states)
        np.testing.assert_array_equal(other.tasks.plants, made.tasks.plants)
        np.testing.assert_array_equal(other.tasks.spreads, made.tasks.spreads)


def test_other_data_have_another_folder_and_another_network_the_same(
    configure: Configure, tmp_path: Path
) -> None:
    for config in (
        configure(**ROBUST),
        configure(**ROBUST | {"optimisation": {"steps": 7, "terminal_weight": 0.5}}),
        configure(**ROBUST, seed=1),
        configure(**ANY_MACHINE),
    ):
        store_of(config, tmp_path).chunk(Stream.TRAINING_DATA, 0, 2)

    assert len(list(tmp_path.iterdir())) == 3


def test_only_robust_plans_are_for_machines_that_may_be_off(
    config: TrainingConfig, tmp_path: Path
) -> None:
    plans = store_of(config, tmp_path).chunk(Stream.TRAINING_DATA, 0, 40)

    share = np.mean(plans.tasks.spreads.any(axis=1))
    assert 0.3 < share < 0.9
