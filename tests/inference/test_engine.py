import gc
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from app.inference.conditioning import Conditioning
from app.inference.device import CPU
from app.inference.engine import Engine, Tick
from app.inference.job import Job
from app.inference.manifest import CHECKPOINT_FILE
from app.inference.model import Model
from app.inference.model_card import Pace
from app.inference.model_store import ModelStore
from app.inference.networks.base import Checkpoint, Network
from app.inference.networks.scripted import ScriptedNetwork
from app.inference.row_threads import RowThreads
from app.inference.solvers import SOLVERS
from app.inference.torchscript import read_torchscript
from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion, Learned
from app.planning.methods.base import InvalidStepCount
from app.planning.methods.sampler import PAPER_SAMPLER, Solver
from app.planning.planner import plan, plan_multistep
from app.planning.plant.system import System
from app.planning.problem import PlanningError, Problem
from app.planning.recipe import Recipe
from app.planning.stop import Stopped
from tests.inference.fakes import (
    NOT_A_NUMBER,
    RAISES,
    ROWS_AT_ONCE,
    TIMEOUT_S,
    Asked,
    FakeNetwork,
    Request,
    Stepped,
    fake_model,
    many,
    submit,
)

PROBLEM = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.0]))


@pytest.fixture
def ticks() -> list[Tick]:
    """The batches that the engine reported."""
    return []


@pytest.fixture
def engine(ticks: list[Tick]) -> Iterator[Engine]:
    engine = Engine(num_threads=1, watch=ticks.append)
    yield engine
    engine.close()


@pytest.fixture(scope="module")
def store(
    publisher: Callable[[Path], Callable[..., Path]],
    tmp_path_factory: pytest.TempPathFactory,
    other_checkpoint: bytes,
) -> Path:
    store = tmp_path_factory.mktemp("store")
    publish = publisher(store)
    publish("first")
    publish("second", content=other_checkpoint)
    return store


@pytest.fixture(scope="module")
def models(store: Path) -> ModelStore:
    return ModelStore.load(store, CPU, RowThreads(1))


@pytest.fixture(scope="module")
def scripted(store: Path, models: ModelStore) -> list[Model]:
    """The two models, by their TorchScript."""

    def network(name: str) -> ScriptedNetwork:
        checkpoint = (store / name / "1" / CHECKPOINT_FILE).read_bytes()
        script = read_torchscript(checkpoint, CPU)
        return ScriptedNetwork(Checkpoint(script, CPU, 64, 20, 4), RowThreads(1))

    return [replace(model, network=network(model.manifest.name)) for model in models.models]


@pytest.fixture
def first(models: ModelStore) -> Model:
    return models.find("first")


def noise(rows: int = 6, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((rows, 64))


def controls(
    engine: Engine,
    model: Model,
    problem: Problem = PROBLEM,
    rows: int = 6,
    seed: int = 0,
    steps: int = 5,
    guidance_scale: float = 2.0,
    solver: Solver = "ddim",
) -> FloatArray:
    proposal = engine.bind(model, Job(2 * rows * steps))
    options = ActionDiffusion(sampler=solver, steps=steps, guidance_scale=guidance_scale)
    sampler = options.settled(model.manifest.samplers)
    return proposal.begin(problem, noise(rows, seed), sampler)().controls


def stepped(model: Model, answers: int = 0) -> tuple[Model, Stepped]:
    network = Stepped(model.network, answers)
    return replace(model, network=network), network


def together(
    engine: Engine, network: Stepped, requests: Sequence[tuple[Model, Asked]]
) -> list[Request]:
    """Submit them all before the first batch of the first one is answered."""
    (model, asked), *rest = requests
    submitted = [submit(engine, model, asked)]
    network.wait_until_asked(1)
    submitted += [submit(engine, model, asked) for model, asked in rest]
    network.let_all()
    return submitted


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_same_noise_gives_the_same_controls(
    engine: Engine, first: Model, solver: Solver
) -> None:
    result = controls(engine, first, solver=solver)

    assert result.shape == (6, 64)
    assert result.dtype == np.float64
    np.testing.assert_array_equal(result, controls(engine, first, solver=solver))
    assert not np.array_equal(result, controls(engine, first, seed=1, solver=solver))


def test_solvers_differ(engine: Engine, first: Model) -> None:
    assert not np.array_equal(controls(engine, first), controls(engine, first, solver="dpm_solver"))


@pytest.mark.parametrize("guidance_scale", [0.0, 1.0, 2.0, 20.0])
@pytest.mark.parametrize(
    ("solver", "steps"), [("ddim", 1), ("ddim", 20), ("dpm_solver", 1), ("dpm_solver", 10)]
)
def test_controls_stay_within_the_limit(
    engine: Engine, first: Model, solver: Solver, steps: int, guidance_scale: float
) -> None:
    result = controls(
        engine, first, rows=32, steps=steps, guidance_scale=guidance_scale, solver=solver
    )

    assert np.all(np.isfinite(result))
    assert np.max(np.abs(result)) <= 0.9 * (1 + 1e-6)
    assert np.max(np.abs(result)) > 0.1


def test_start_and_target_both_matter_unless_guidance_is_off(engine: Engine, first: Model) -> None:
    others = [
        Problem(np.array([0.5, -0.2]), PROBLEM.target_state),
        Problem(np.array([0.1, 0.3]), PROBLEM.target_state),
        Problem(PROBLEM.initial_state, np.array([-0.4, 0.0])),
        Problem(PROBLEM.initial_state, np.array([0.4, 0.2])),
    ]
    for other in others:
        assert not np.array_equal(controls(engine, first), controls(engine, first, other))
        np.testing.assert_array_equal(
            controls(engine, first, guidance_scale=0.0),
            controls(engine, first, other, guidance_scale=0.0),
        )


def test_states_are_standardised_by_the_constants_of_the_manifest(
    tmp_path: Path, publisher: Callable[[Path], Callable[..., Path]], engine: Engine
) -> None:
    publish = publisher(tmp_path)
    unit = Conditioning.on_states((0.0, 0.0), (1.0, 1.0))
    scaled = Conditioning.on_states((0.25, -0.5), (2.0, 4.0))
    publish("unit", condition=unit)
    publish("scaled", condition=scaled)
    models = engine.load(tmp_path, CPU)
    # (x - mean) / std of these is the problem for the other model: powers of two, so exactly.
    far = Problem(np.array([1.25, 1.5]), np.array([-0.75, -0.5]))
    near = Problem(np.array([0.5, 0.5]), np.array([-0.5, 0.0]))

    np.testing.assert_array_equal(
        controls(engine, models.find("scaled"), far),
        controls(engine, models.find("unit"), near),
    )


def test_each_proposal_samples_its_own_model(engine: Engine, models: ModelStore) -> None:
    first, second = (models.find(name) for name in ("first", "second"))

    assert not np.array_equal(controls(engine, first), controls(engine, second))


def test_a_row_does_not_depend_on_the_rows_beside_it(engine: Engine, first: Model) -> None:
    alone = controls(engine, first, rows=1)

    np.testing.assert_allclose(controls(engine, first, rows=6)[:1], alone, atol=1e-4)


def test_requests_from_many_threads_get_what_they_would_get_alone(
    engine: Engine, models: ModelStore
) -> None:
    requests = [
        (models.models[i % 2], Problem(np.zeros(2), np.array([0.1 * i, 0.0])), 1 + i % 5, i)
        for i in range(24)
    ]
    alone = [controls(engine, *request) for request in requests]

    with ThreadPoolExecutor(max_workers=8) as threads:
        together = list(threads.map(lambda request: controls(engine, *request), requests))

    for result, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(result, expected)


@pytest.mark.parametrize("by", ["compiled", "scripted"])
def test_requests_of_every_kind_in_one_batch_get_what_they_would_get_alone(
    engine: Engine, models: ModelStore, scripted: list[Model], by: str
) -> None:
    originals = models.models if by == "compiled" else scripted
    waiting, network = stepped(originals[0])
    served = [waiting, originals[1]]
    asked = many(24, seed=1, horizon=64, most=12)

    requests = together(engine, network, [(served[i % 2], one) for i, one in enumerate(asked)])

    # TorchScript rounds otherwise in other slices, which DDIM's first step and the guidance amplify
    # a thousandfold where nothing was learned.
    tolerance = 0.0 if by == "compiled" else 5e-3
    for i, request in enumerate(requests):
        expected = asked[i].alone(originals[i % 2])
        assert expected.std() > 0.1
        np.testing.assert_allclose(request.controls, expected, rtol=0, atol=tolerance)
        assert request.job.rows_left == 0
    # And they did share batches.
    assert network.times_at_once > 1


def test_a_request_of_several_samplings_shares_the_network_with_others(
    engine: Engine, ticks: list[Tick], models: ModelStore
) -> None:
    targets = [np.array([position, 0.0]) for position in (0.4, -0.2, 0.3)]
    num_candidates, steps, served = 5, 4, models.models

    def make(index: int) -> tuple[FloatArray, int]:
        job = Job(len(targets) * 2 * num_candidates * steps)
        proposal = engine.bind(served[index % 2], job)
        result = plan_multistep(
            Problem(np.zeros(2), np.zeros(2)),
            targets,
            Recipe(Learned(Asked(steps=steps).sampler, proposal), num_candidates),
            np.random.default_rng(index),
            job.stop,
        )
        return result.controls, job.rows_left

    alone = [make(index) for index in range(8)]
    with ThreadPoolExecutor(max_workers=8) as threads:
        together = list(threads.map(make, range(8)))

    for (result, rows_left), (expected, _) in zip(together, alone, strict=True):
        np.testing.assert_array_equal(result, expected)
        assert rows_left == 0
    # The last batch is reported after its last request is done.
    engine.close()
    assert sum(tick.rows for tick in ticks) == 2 * 8 * len(targets) * 2 * num_candidates * steps


def test_an_idle_engine_begins_at_once_without_waiting_for_company(engine: Engine) -> None:
    model, network = stepped(fake_model(FakeNetwork()))

    for asked in range(1, 4):
        request = submit(engine, model, Asked(1, 1, guidance_scale=1.0))
        network.wait_until_asked(asked)
        network.let(1)
        assert request.controls.shape == (1, 8)


def test_a_request_joins_between_two_batches_and_the_others_go_on(engine: Engine) -> None:
    fake = FakeNetwork()
    model, network = stepped(fake_model(fake))
    asked = [Asked(4, 6, guidance_scale=1.0, seed=1), Asked(3, 2, guidance_scale=1.0, seed=2)]

    requests = [submit(engine, model, asked[0])]
    network.wait_until_asked(1)
    network.let(1)
    network.wait_until_asked(2)
    requests.append(submit(engine, model, asked[1]))
    network.let_all()

    for request, one in zip(requests, asked, strict=True):
        np.testing.assert_array_equal(request.controls, one.alone(fake_model(FakeNetwork())))
    # In the third batch both, at their own times; and in the last ones the first alone again.
    assert [len(u_t) for u_t, _, _ in fake.batches] == [4, 4, 7, 7, 4, 4]
    _, times, _ = fake.batches[2]
    assert sorted(set(times.tolist())) == [23, 39]


def test_a_small_request_is_done_long_before_a_large_one_that_came_earlier(
    engine: Engine, ticks: list[Tick]
) -> None:
    model, network = stepped(fake_model(FakeNetwork()))
    large, small = Asked(200, 10, guidance_scale=1.0), Asked(4, 3, guidance_scale=2.0)
    ends: dict[str, int] = {}

    def note_end(name: str) -> Callable[[object], None]:
        return lambda _: ends.update({name: len(ticks)})

    requests = [submit(engine, model, large)]
    network.wait_until_asked(1)
    requests.append(submit(engine, model, small))
    for name, request in zip(("large", "small"), requests, strict=True):
        request.done.add_done_callback(note_end(name))
    network.let_all()

    assert [request.controls.shape for request in requests] == [(200, 8), (4, 8)]
    # Whoever waits for a request is woken before its end is noted.
    engine.close()
    # After the batch that was under way, one for each step of the small one.
    assert ends["small"] == 3
    assert ends["large"] >= large.rows // ROWS_AT_ONCE


class Gone(Stopped):
    pass


def test_a_request_that_is_stopped_leaves_at_the_next_batch_and_the_others_go_on(
    engine: Engine,
) -> None:
    fake = FakeNetwork()
    model, network = stepped(fake_model(fake))
    # Each with a start and a target of its own, by which its rows are known.
    asked = [Asked(3, 8, guidance_scale=1.0, seed=seed) for seed in range(3)]
    reason = Gone()

    requests = [submit(engine, model, one) for one in asked[:1]]
    network.wait_until_asked(1)
    requests += [submit(engine, model, one) for one in asked[1:]]
    network.let(2)
    network.wait_until_asked(3)
    requests[1].job.stop.set(reason)
    network.let(1)
    with pytest.raises(Gone) as raised:
        assert requests[1].controls is None
    assert raised.value is reason
    network.let_all()

    for request in (requests[0], requests[2]):
        expected = request.asked.alone(fake_model(FakeNetwork()))
        np.testing.assert_array_equal(request.controls, expected)
    # Rows of how many requests each batch had.
    requests_in = [len(set(embedding[:, 0].tolist())) for _, _, embedding in fake.batches]
    assert requests_in == [1, 3, 3, 2, 2, 2, 2, 2, 1]
    assert requests[1].job.rows_left == 3 * 6


def test_a_request_that_was_stopped_before_it_began_never_reaches_the_network(
    engine: Engine,
) -> None:
    fake = FakeNetwork()
    model, network = stepped(fake_model(fake))

    running = submit(engine, model, Asked(2, 2, guidance_scale=1.0))
    network.wait_until_asked(1)
    stopped = submit(engine, model, Asked(9, 2, guidance_scale=1.0))
    stopped.job.stop.set(Gone())
    network.let_all()

    with pytest.raises(Gone):
        assert stopped.controls is None
    assert running.controls.shape == (2, 8)
    assert len(fake.embedded) == 1
    assert [len(u_t) for u_t, _, _ in fake.batches] == [2, 2]


@pytest.mark.parametrize(
    ("failure", "reason"),
    [
        (RAISES, "fake/1 failed: on demand"),
        (NOT_A_NUMBER, "fake/1 predicts what is not"),
    ],
    ids=["raises", "not finite"],
)
def test_what_goes_wrong_with_one_request_is_not_felt_by_those_in_its_batch(
    engine: Engine, failure: float, reason: str
) -> None:
    model, network = stepped(fake_model(FakeNetwork(), rows_at_once=64))
    asked = [Asked(3 + i, 6, failure=failure if i in (2, 4) else 0.0, seed=i) for i in range(6)]

    requests = together(engine, network, [(model, one) for one in asked])

    for request in requests:
        if request.asked.failure:
            with pytest.raises(PlanningError, match=reason):
                assert request.controls is None
        else:
            expected = request.asked.alone(fake_model(FakeNetwork()))
            np.testing.assert_array_equal(request.controls, expected)


def test_a_prediction_that_is_not_finite_costs_the_others_in_its_batch_nothing(
    engine: Engine,
) -> None:
    fake = FakeNetwork()
    model, network = stepped(fake_model(fake, rows_at_once=64))
    bad = Asked(3, 6, failure=NOT_A_NUMBER)

    requests = together(engine, network, [(model, one) for one in (bad, *many(5, seed=6, most=9))])
    for request in requests:
        request.done.exception(TIMEOUT_S)

    predicted = sum(int((embedding[:, 1] == 0).sum()) for _, _, embedding in fake.batches)
    assert predicted == sum(request.asked.rows for request in requests[1:])


class AnswersTooFewRows(FakeNetwork):
    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        return super().predict(u_t, t, embedding)[1:]


class CannotEmbed(FakeNetwork):
    def embed(self, condition: Tensor) -> Tensor:  # noqa: ARG002
        raise ArithmeticError("no condition suits me")


@pytest.mark.parametrize(
    ("bad", "error"), [(AnswersTooFewRows(), PlanningError), (CannotEmbed(), ArithmeticError)]
)
def test_a_bad_model_fails_its_own_requests_and_no_others(
    engine: Engine, bad: Network, error: type[Exception]
) -> None:
    good = [fake_model(FakeNetwork(slope), f"good{slope}") for slope in (0.2, 0.4)]
    waiting, network = stepped(good[0])
    served = [waiting, fake_model(bad, "bad"), good[1]]

    asked = many(12, seed=2)
    requests = together(engine, network, [(served[i % 3], one) for i, one in enumerate(asked)])

    for i, request in enumerate(requests):
        if i % 3 == 1:
            with pytest.raises(error):
                assert request.controls is None
        else:
            expected = request.asked.alone(good[(i % 3) // 2])
            np.testing.assert_array_equal(request.controls, expected)


def test_batches_are_reported_and_add_up_to_the_rows_of_all_requests(
    engine: Engine, ticks: list[Tick]
) -> None:
    model, network = stepped(fake_model(FakeNetwork()))
    other = fake_model(FakeNetwork(0.5), "other")
    asked = many(10, seed=3)

    requests = together(
        engine, network, [(model if i % 2 == 0 else other, one) for i, one in enumerate(asked)]
    )
    for request in requests:
        request.done.exception(TIMEOUT_S)
    # The last batch is reported after its last request is done.
    engine.close()

    for one, own in ((model, asked[::2]), (other, asked[1::2])):
        assert sum(tick.rows for tick in ticks if tick.model is one) == sum(o.rows for o in own)
    assert all(1 <= tick.rows <= ROWS_AT_ONCE for tick in ticks)
    assert all(tick.seconds > 0 for tick in ticks)
    assert {request.job.rows_left for request in requests} == {0}


def test_an_idle_engine_keeps_no_model_that_nobody_else_does() -> None:
    """Reloading would else keep the old model's weights until the next request."""
    engine = Engine(num_threads=1)
    model = fake_model(FakeNetwork())
    network = weakref.ref(model.network)
    for asked in (Asked(40, 8), Asked(failure=NOT_A_NUMBER, steps=8), Asked(steps=99), Asked()):
        submit(engine, model, asked).done.exception(TIMEOUT_S)

    del model
    for _ in range(3):
        # The engine's thread has ended its batch soon after the request has its controls.
        threading.Event().wait(0.01)
        gc.collect()
    kept = network()
    engine.close()

    assert kept is None


@pytest.mark.parametrize(
    "problem",
    [
        Problem(np.zeros(2), np.zeros(2), System(static_friction=0.8)),
        Problem(np.zeros(2), np.zeros(2), System(time_step=0.04)),
    ],
    ids=["static friction", "time step"],
)
def test_a_plant_that_the_model_was_not_trained_for_is_refused(
    engine: Engine, first: Model, problem: Problem
) -> None:
    with pytest.raises(ValueError, match="another plant or horizon"):
        controls(engine, first, problem)


def test_a_horizon_that_the_model_was_not_trained_for_is_refused(
    engine: Engine, first: Model
) -> None:
    problem = Problem(np.zeros(2), np.zeros(2), horizon=32)

    with pytest.raises(ValueError, match="another plant or horizon"):
        engine.bind(first, Job(0)).begin(problem, noise()[:, :32], PAPER_SAMPLER)


@pytest.mark.parametrize(("solver", "available"), [("ddim", 20), ("dpm_solver", 10)])
def test_more_steps_than_the_model_has_times_are_refused_and_the_engine_lives_on(
    engine: Engine, first: Model, solver: Solver, available: int
) -> None:
    with pytest.raises(InvalidStepCount, match=f"from 1 to {available}"):
        controls(engine, first, steps=available + 1, solver=solver)
    assert controls(engine, first, steps=20).shape == (6, 64)


def test_a_request_that_is_refused_is_not_felt_by_those_under_way(engine: Engine) -> None:
    model, network = stepped(fake_model(FakeNetwork()))
    asked = [Asked(5, 4, seed=1), Asked(5, 41), Asked(5, 4, seed=2)]

    good, bad, other = together(engine, network, [(model, one) for one in asked])

    with pytest.raises(InvalidStepCount):
        assert bad.controls is None
    for request in (good, other):
        expected = request.asked.alone(fake_model(FakeNetwork()))
        np.testing.assert_array_equal(request.controls, expected)


def test_a_plan_by_the_engine_can_be_had_again(engine: Engine, first: Model) -> None:
    def make() -> FloatArray:
        rng = np.random.default_rng(3)
        proposal = engine.bind(first, Job(80))
        return plan(PROBLEM, Recipe(Learned(Asked(steps=5).sampler, proposal), 8), rng).controls

    np.testing.assert_array_equal(make(), make())


def test_a_request_waits_until_its_first_batch_and_no_longer(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 1.0
    monkeypatch.setattr("app.inference.engine.perf_counter", lambda: now)
    model, network = stepped(fake_model(FakeNetwork()))
    asked = Asked(4, 3)

    with ThreadPoolExecutor(max_workers=1) as threads:
        proposal = engine.bind(model, Job(asked.rows))
        running = threads.submit(proposal.begin(asked.problem, asked.noise, asked.sampler))
        network.wait_until_asked(1)
        now = 7.0
        behind = submit(engine, model, asked)
        now = 10.0
        network.let_all()

        assert running.result(TIMEOUT_S).queue_ms == 0
    _, begun = behind.done.result(TIMEOUT_S)
    assert begun == 10.0


def test_closing_finishes_what_was_begun(first: Model) -> None:
    engine = Engine(num_threads=1)
    model, network = stepped(replace(first, pace=Pace(128, 1e-3)))
    with ThreadPoolExecutor(max_workers=2) as threads:
        pending = threads.submit(controls, engine, model, PROBLEM, 64, 0, 20)
        network.wait_until_asked(1)
        closing = threads.submit(engine.close)
        while not closed(engine):
            assert not closing.done()
        assert not pending.done()
        network.let(20)

        closing.result(TIMEOUT_S)
        assert pending.result(TIMEOUT_S).shape == (64, 64)


def closed(engine: Engine) -> bool:
    try:
        engine.submit(Job(0), lambda: pytest.fail("it was taken on"))
    except RuntimeError as error:
        return str(error) == "the engine is closed"
    return False


def test_closing_finishes_what_waits_and_refuses_what_comes_later(first: Model) -> None:
    engine = Engine(num_threads=1)
    model, network = stepped(fake_model(FakeNetwork()))
    requests = [submit(engine, model, one) for one in many(5, seed=4)]
    network.let_all()
    engine.close()

    for request in requests:
        assert request.done.done()
        expected = request.asked.alone(fake_model(FakeNetwork()))
        np.testing.assert_array_equal(request.controls, expected)
    with pytest.raises(RuntimeError, match="closed"):
        submit(engine, model, Asked())
    with pytest.raises(RuntimeError, match="closed"):
        controls(engine, first)
    engine.close()


def test_the_network_keeps_to_its_threads(first: Model) -> None:
    before = torch.get_num_threads()
    engine = Engine(num_threads=1)
    try:
        controls(engine, first)
        assert torch.get_num_threads() == before
    finally:
        engine.close()
