"""Work of a training on a cluster: the same, to the byte, as in this process."""

import os
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from training.config import PlansConfig, TrainingConfig
from training.experts import Plans, draw_plans
from training.streams import Stream, generator

pytestmark = pytest.mark.slow
CONFIG = Path(__file__).parents[2] / "training/any-machine.toml"


def draw(config: TrainingConfig, index: int) -> Plans:
    data = config.data
    assert isinstance(data, PlansConfig)
    rng = generator(config.seed, Stream.TRAINING_DATA, index)
    return draw_plans(data.machines, data.experts, config.prior, 8, data.horizon, rng)


def drawn_by(executor: Executor) -> list[Plans]:
    with executor:
        return list(executor.map(partial(draw, TrainingConfig.read(CONFIG)), range(4)))


def test_expert_plans_of_a_cluster_are_those_of_one_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("ray")
    from training.on_ray import RayExecutor

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(CONFIG.parents[1])]))
    here, there = drawn_by(ThreadPoolExecutor(1)), drawn_by(RayExecutor())
    for ours, theirs in zip(here, there, strict=True):
        assert ours.controls.tobytes() == theirs.controls.tobytes()
        assert ours.tasks.states.tobytes() == theirs.tasks.states.tobytes()
    assert not np.array_equal(here[0].controls, here[1].controls)
