import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from app.inference.engine import Engine, EngineProposal
from app.inference.model_store import Model, ModelStore
from app.inference.network import Network
from app.inference.row_threads import RowThreads
from app.inference.samplers import SAMPLERS, InvalidStepCount
from app.planning.methods import ActionDiffusion
from app.planning.planner import plan
from app.planning.problem import Problem
from app.planning.system import FloatArray, System

PROBLEM = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]))


@pytest.fixture
def engine() -> Iterator[Engine]:
    engine = Engine(num_threads=1)
    yield engine
    engine.close()


@pytest.fixture(scope="module")
def models(
    publisher: Callable[[Path], Callable[..., Path]],
    tmp_path_factory: pytest.TempPathFactory,
    other_checkpoint: bytes,
) -> ModelStore:
    store = tmp_path_factory.mktemp("store")
    publish = publisher(store)
    publish("first")
    publish("second", content=other_checkpoint)
    return ModelStore.load(store, torch.device("cpu"), RowThreads(1))


@pytest.fixture
def proposal(engine: Engine, models: ModelStore) -> EngineProposal:
    return engine.bind(models.find("first"))


def noise(rows: int = 6, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((rows, 64))


def controls(
    proposal: EngineProposal,
    problem: Problem = PROBLEM,
    rows: int = 6,
    seed: int = 0,
    steps: int = 5,
    guidance_scale: float = 2.0,
    sampler: str = "ddim",
) -> FloatArray:
    return proposal.sample(problem, noise(rows, seed), sampler, steps, guidance_scale).controls


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_same_noise_gives_the_same_controls(proposal: EngineProposal, sampler: str) -> None:
    first = controls(proposal, sampler=sampler)

    assert first.shape == (6, 64)
    assert first.dtype == np.float64
    np.testing.assert_array_equal(first, controls(proposal, sampler=sampler))
    assert not np.array_equal(first, controls(proposal, seed=1, sampler=sampler))


def test_samplers_differ(proposal: EngineProposal) -> None:
    assert not np.array_equal(controls(proposal), controls(proposal, sampler="dpm_solver"))


@pytest.mark.parametrize("guidance_scale", [0.0, 1.0, 2.0, 20.0])
@pytest.mark.parametrize(
    ("sampler", "steps"), [("ddim", 1), ("ddim", 20), ("dpm_solver", 1), ("dpm_solver", 10)]
)
def test_controls_stay_within_the_limit(
    proposal: EngineProposal, sampler: str, steps: int, guidance_scale: float
) -> None:
    result = controls(
        proposal, rows=32, steps=steps, guidance_scale=guidance_scale, sampler=sampler
    )

    assert np.all(np.isfinite(result))
    assert np.max(np.abs(result)) <= 0.9 * (1 + 1e-6)
    assert np.max(np.abs(result)) > 0.1


def test_start_and_target_both_matter_unless_guidance_is_off(proposal: EngineProposal) -> None:
    others = [
        Problem(np.array([0.5, -0.2]), PROBLEM.target_state),
        Problem(np.array([0.1, 0.3]), PROBLEM.target_state),
        Problem(PROBLEM.initial_state, np.array([-0.4, 0.0])),
        Problem(PROBLEM.initial_state, np.array([0.4, 0.2])),
    ]
    for other in others:
        assert not np.array_equal(controls(proposal), controls(proposal, other))
        np.testing.assert_array_equal(
            controls(proposal, guidance_scale=0.0),
            controls(proposal, other, guidance_scale=0.0),
        )


def test_states_are_standardised_and_controls_scaled_by_the_constants_of_the_manifest(
    store: Path, publish: Callable[..., Path], engine: Engine
) -> None:
    publish("unit", state_mean=(0.0, 0.0), state_std=(1.0, 1.0), control_scale=1.0)
    publish("scaled", state_mean=(0.25, -0.5), state_std=(2.0, 4.0), control_scale=0.5)
    models = engine.load(store, torch.device("cpu"))
    # (x - mean) / std of these is the problem for the other model: powers of two, so exactly.
    scaled = Problem(np.array([1.25, 1.5]), np.array([-0.75, -0.5]))
    unit = Problem(np.array([0.5, 0.5]), np.array([-0.5, 0.0]))

    np.testing.assert_array_equal(
        2 * controls(engine.bind(models.find("scaled")), scaled),
        controls(engine.bind(models.find("unit")), unit),
    )


def test_each_proposal_samples_its_own_model(engine: Engine, models: ModelStore) -> None:
    first, second = (engine.bind(models.find(name)) for name in ("first", "second"))

    assert not np.array_equal(controls(first), controls(second))


def test_a_row_does_not_depend_on_the_rows_beside_it(proposal: EngineProposal) -> None:
    alone = controls(proposal, rows=1)

    np.testing.assert_allclose(controls(proposal, rows=6)[:1], alone, atol=1e-4)


def test_requests_from_many_threads_get_what_they_would_get_alone(
    engine: Engine, models: ModelStore
) -> None:
    proposals = [engine.bind(models.find(name)) for name in ("first", "second")]
    requests = [
        (proposals[i % 2], Problem(np.zeros(2), np.array([0.1 * i, 0.0])), 1 + i % 5, i)
        for i in range(24)
    ]
    alone = [controls(*request) for request in requests]

    with ThreadPoolExecutor(max_workers=8) as threads:
        together = list(threads.map(lambda request: controls(*request), requests))

    for result, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(result, expected)


@pytest.mark.parametrize(
    "problem",
    [
        Problem(np.zeros(2), np.zeros(2), System(static_friction=0.8)),
        Problem(np.zeros(2), np.zeros(2), System(time_step=0.04)),
    ],
    ids=["static friction", "time step"],
)
def test_a_plant_that_the_model_was_not_trained_for_is_refused(
    proposal: EngineProposal, problem: Problem
) -> None:
    with pytest.raises(ValueError, match="another plant or horizon"):
        proposal.sample(problem, noise(), "ddim", 5, 2.0)


def test_a_horizon_that_the_model_was_not_trained_for_is_refused(
    proposal: EngineProposal,
) -> None:
    problem = Problem(np.zeros(2), np.zeros(2), horizon=32)

    with pytest.raises(ValueError, match="another plant or horizon"):
        proposal.sample(problem, noise()[:, :32], "ddim", 5, 2.0)


@pytest.mark.parametrize(("sampler", "available"), [("ddim", 20), ("dpm_solver", 10)])
def test_more_steps_than_the_model_has_times_are_refused_and_the_engine_lives_on(
    proposal: EngineProposal, sampler: str, available: int
) -> None:
    for steps in (0, available + 1):
        with pytest.raises(InvalidStepCount, match=f"from 1 to {available}"):
            controls(proposal, steps=steps, sampler=sampler)
    assert controls(proposal, steps=20).shape == (6, 64)


def test_a_plan_by_the_engine_can_be_had_again(engine: Engine, models: ModelStore) -> None:
    def make(model: Model) -> FloatArray:
        rng = np.random.default_rng(3)
        return plan(PROBLEM, ActionDiffusion(steps=5), 8, rng, engine.bind(model)).controls

    np.testing.assert_array_equal(make(models.find("first")), make(models.find("first")))


class Announcing:
    """A network that tells when it is asked for the first time, and counts."""

    def __init__(self, network: Network) -> None:
        self.embed = network.embed
        self.network = network
        self.asked = threading.Event()
        self.answers = 0

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        self.asked.set()
        noise = self.network.predict(u_t, t, embedding)
        self.answers += 1
        return noise


def test_closing_finishes_what_was_begun(models: ModelStore) -> None:
    engine = Engine(num_threads=1)
    model = models.find("first")
    network = Announcing(model.network)
    proposal = engine.bind(replace(model, network=network))
    with ThreadPoolExecutor(max_workers=1) as threads:
        pending = threads.submit(controls, proposal, PROBLEM, 64, 0, 20)
        assert network.asked.wait(timeout=60)
        engine.close()

        assert network.answers == 20
        assert pending.result().shape == (64, 64)


def test_the_network_keeps_to_its_threads(models: ModelStore) -> None:
    before = torch.get_num_threads()
    engine = Engine(num_threads=1)
    try:
        controls(engine.bind(models.find("first")))
        assert torch.get_num_threads() == before
    finally:
        engine.close()
