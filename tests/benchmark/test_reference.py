"""The reference is the checkpoint's equal, so that what it is compared with is the same."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from app.benchmark.reference import PaperNetwork, Reference
from app.inference.device import CPU
from app.inference.engine import Engine
from app.inference.job import Job
from app.inference.model_store import ModelStore
from app.inference.torchscript import read_torchscript
from app.inference.verification import verify
from app.planning.methods import Learned
from app.planning.methods.sampler import PAPER_SAMPLER
from app.planning.problem import Problem

PROBLEM = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]))


@pytest.fixture(scope="module")
def script(model_store: Path) -> torch.jit.ScriptModule:
    _, checkpoint = verify(model_store / "tiny" / "1")
    return read_torchscript(checkpoint, CPU)


@pytest.fixture
def engine() -> Iterator[Engine]:
    engine = Engine(num_threads=1)
    yield engine
    engine.close()


@pytest.fixture
def models(engine: Engine, model_store: Path) -> ModelStore:
    return engine.load(model_store, CPU)


@torch.inference_mode()
def test_the_network_is_that_of_the_checkpoint(script: torch.jit.ScriptModule) -> None:
    generator = torch.Generator().manual_seed(0)
    u_t = torch.randn(6, 1, 64, generator=generator)
    t = torch.tensor([0, 1, 50, 100, 150, 199])
    conditions = torch.randn(6, 4, generator=generator)
    keep = torch.ones(6, dtype=torch.bool)
    network = PaperNetwork(script.state_dict())

    for given, kept in ((conditions, keep), (None, ~keep)):
        torch.testing.assert_close(
            network(u_t, t, given), script(u_t, t, conditions, kept), rtol=0, atol=1e-5
        )


def test_the_engine_samples_the_same_controls_with_the_setting_of_the_paper(
    model_store: Path, engine: Engine, models: ModelStore
) -> None:
    model = models.find("tiny")
    noise = np.random.default_rng(3).standard_normal((5, 64))
    manifest, checkpoint = verify(model_store / "tiny" / "1")
    expected = Reference(checkpoint, manifest).sample(PROBLEM, noise)

    proposal = engine.bind(model, Job(5 * PAPER_SAMPLER.cost(5).network_evaluations))
    controls = (
        Learned(PAPER_SAMPLER, proposal).propose(PROBLEM, 5, np.random.default_rng(3)).controls
    )

    assert expected.std() > 0.1
    np.testing.assert_allclose(controls, expected, rtol=0, atol=1e-4)
