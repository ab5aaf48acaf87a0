from pathlib import Path

import numpy as np
import pytest
import torch

from app.inference.device import CPU
from tests.training.conftest import ANY_MACHINE, Configure
from training.config import PlansConfig, TrainingConfig
from training.plan_store import PlanStore
from training.plans import PlanData


@pytest.fixture(scope="module")
def config(configure: Configure) -> TrainingConfig:
    return configure(**ANY_MACHINE)


def data_of(config: TrainingConfig, folder: Path) -> PlanData:
    assert isinstance(config.data, PlansConfig)
    return PlanData(config, config.data, CPU, PlanStore(config, config.data, folder))


def test_conditions_of_plans_and_mirror_images_are_standard(
    config: TrainingConfig, tmp_path: Path
) -> None:
    data = data_of(config, tmp_path)
    conditions = data.validation.conditions

    assert conditions.shape == (60, data.conditioning.size)
    torch.testing.assert_close(
        conditions.mean(dim=0), torch.zeros(data.conditioning.size), atol=1e-5, rtol=0
    )
    torch.testing.assert_close(
        conditions.std(dim=0, correction=0), torch.ones(data.conditioning.size), atol=1e-4, rtol=0
    )
    data.close()


def test_batches_are_drawn_from_the_latest_chunks_alone(
    config: TrainingConfig, tmp_path: Path
) -> None:
    data = data_of(config, tmp_path)
    seen: dict[int, set[bytes]] = {}
    for step in range(13):
        batch = data.batch(step)
        assert batch.controls.shape == (32, 1, 16)
        assert batch.controls.abs().max() <= 1
        rows = {row.numpy().tobytes() for row in batch.controls}
        seen.setdefault(step // 4, set()).update(rows)
    data.close()

    # Three chunks are kept: of those of the first steps none is left after three more have come.
    assert seen[0] & seen[1]
    assert not seen[0] & seen[3]


def test_a_step_has_the_same_batch_whenever_training_begins(
    config: TrainingConfig, tmp_path: Path
) -> None:
    first, resumed = data_of(config, tmp_path), data_of(config, tmp_path)
    for step in range(9):
        batch = first.batch(step)
    again = resumed.batch(8)

    assert torch.equal(batch.controls, again.controls)
    assert torch.equal(batch.conditions, again.conditions)
    assert batch.tasks is not None
    assert again.tasks is not None
    np.testing.assert_array_equal(batch.tasks.states, again.tasks.states)
    np.testing.assert_array_equal(batch.tasks.plants, again.tasks.plants)
    first.close()
    resumed.close()


def test_the_manifest_is_told_what_the_plans_were(config: TrainingConfig, tmp_path: Path) -> None:
    data = data_of(config, tmp_path)
    data.close()

    assert data.description == (
        "Plans for random machines and tasks: 50% rollouts of random controls, 40% exact plans of "
        "least energy, 10% exact plans of least energy with a margin of static friction."
    )
