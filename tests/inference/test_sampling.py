"""One sampling: what it asks of the network, and what it makes of the answers."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from app.inference.job import Job
from app.inference.sampling import Sampling
from app.inference.solvers import SOLVERS
from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion
from app.planning.methods.base import InvalidStepCount
from app.planning.methods.sampler import Sampler, Samplers, SamplerSettings, Solver
from app.planning.plant.coverage import Coverage
from app.planning.plant.system import ControlLimits, System
from app.planning.problem import PlanningError, Problem
from tests.inference.fakes import HORIZON, Asked, FakeNetwork, fake_model

every_solver = pytest.mark.parametrize("solver", SOLVERS)


class TellsConditionsApart:
    """A network that answers 1 for rows with their condition and 10 for rows without."""

    def __init__(self) -> None:
        self.embedded: list[Tensor] = []
        self.calls: list[tuple[Tensor, Tensor, Tensor]] = []

    def embed(self, condition: Tensor) -> Tensor:
        self.embedded.append(condition)
        return torch.stack([condition, torch.zeros(4)])

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        self.calls.append((u_t.clone(), t.clone(), embedding.clone()))
        return torch.where(embedding.any(dim=1, keepdim=True), 1.0, 10.0) * u_t / 20


def finish(sampling: Sampling, portions: Sequence[int] = ()) -> FloatArray:
    """Take it through its model, these portions of rows first, then all that wait."""
    left = list(portions)
    while sampling.controls is None:
        count = min(left.pop(), sampling.rows_waiting) if left else sampling.rows_waiting
        sampling.give(sampling.model.network.predict(*sampling.take(count)))
    return sampling.controls


def expected(asked: Asked, factor: float) -> FloatArray:
    """Return what the solver makes of predictions that are `factor` times its own sequence."""
    levels = fake_model(TellsConditionsApart()).noise_levels
    noise = torch.tensor(asked.noise, dtype=torch.float32)
    steps = SOLVERS[asked.solver](noise, times(asked), levels, "noise")
    u, _ = next(steps)
    while True:
        try:
            u, _ = steps.send(factor * u)
        except StopIteration as done:
            controls: Tensor = done.value
            return controls.double().numpy() * System().plant.highest_control


def times(asked: Asked) -> list[int]:
    return fake_model(TellsConditionsApart()).manifest.times(asked.sampler.settings)


@every_solver
@pytest.mark.parametrize(
    ("guidance_scale", "with_condition"), [(1.0, True), (0.0, False)], ids=["one", "nought"]
)
def test_guidance_of_one_or_nought_asks_for_one_prediction_of_each_candidate(
    solver: Solver, guidance_scale: float, with_condition: bool
) -> None:
    network = TellsConditionsApart()
    asked = Asked(3, 4, solver, guidance_scale)

    controls = finish(asked.sampling(fake_model(network)))

    (condition,) = network.embedded
    for u_t, _, embedding in network.calls:
        assert u_t.shape == (3, HORIZON)
        assert torch.equal(embedding, with_condition * condition.expand(3, -1))
    assert torch.equal(network.calls[0][0], torch.tensor(asked.noise, dtype=torch.float32))
    answer = 1 / 20 if with_condition else 10 / 20
    np.testing.assert_allclose(controls, expected(asked, answer), rtol=0, atol=1e-6)


@every_solver
@pytest.mark.parametrize("guidance_scale", [0.5, 2.0, 7.5])
def test_guidance_weighs_the_prediction_with_the_condition_and_that_without(
    solver: Solver, guidance_scale: float
) -> None:
    network = TellsConditionsApart()
    asked = Asked(3, 4, solver, guidance_scale)

    controls = finish(asked.sampling(fake_model(network)))

    (condition,) = network.embedded
    for u_t, _, embedding in network.calls:
        keep = embedding.any(dim=1)
        assert sorted(keep.tolist()) == [False] * 3 + [True] * 3
        assert torch.equal(embedding[keep], condition.expand(3, -1))
        assert torch.equal(u_t[keep], u_t[~keep])
    # eps_uncond + s (eps_cond - eps_uncond)
    answer = (10 + guidance_scale * (1 - 10)) / 20
    np.testing.assert_allclose(controls, expected(asked, answer), rtol=0, atol=1e-5)


@every_solver
@pytest.mark.parametrize(("scale", "rows"), [(0.0, 3), (1.0, 3), (2.0, 6)])
def test_it_embeds_once_and_asks_for_one_batch_a_step(
    solver: Solver, scale: float, rows: int
) -> None:
    network = TellsConditionsApart()
    asked = Asked(3, 7, solver, scale)

    finish(asked.sampling(fake_model(network)))

    assert len(network.embedded) == 1
    assert [t.tolist() for _, t, _ in network.calls] == [
        [time] * rows for time in times(asked)[:-1]
    ]
    assert {t.dtype for _, t, _ in network.calls} == {torch.int64}


@given(
    candidates=st.integers(1, 9),
    solver=st.sampled_from(("ddim", "dpm_solver")),
    guidance_scale=st.sampled_from([0.0, 1.0, 2.0]),
    portions=st.lists(st.integers(1, 20), max_size=30),
)
def test_the_rows_may_be_taken_in_any_portions(
    candidates: int, solver: Solver, guidance_scale: float, portions: list[int]
) -> None:
    asked = Asked(candidates, 4, solver, guidance_scale)
    model = fake_model(FakeNetwork())
    job = Job(asked.rows)

    controls = finish(asked.sampling(model, job), portions)

    np.testing.assert_array_equal(controls, asked.alone(model))
    assert job.rows_left == 0


def test_rows_wait_until_they_are_predicted() -> None:
    job = Job(rows_left=100)
    sampling = Asked(num_candidates=4, steps=2, guidance_scale=2.0).sampling(
        fake_model(FakeNetwork()), job
    )

    seen = []
    while sampling.controls is None:
        seen.append((sampling.rows_waiting, job.rows_left))
        sampling.give(torch.zeros_like(sampling.take(min(5, sampling.rows_waiting)).u_t))

    assert seen == [(8, 100), (3, 95), (8, 92), (3, 87)]
    assert (sampling.rows_waiting, job.rows_left) == (0, 84)


@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
@pytest.mark.parametrize("row", [0, 3])
def test_a_prediction_that_is_not_finite_is_refused_by_the_name_of_its_model(
    value: float, row: int
) -> None:
    sampling = Asked(num_candidates=4, guidance_scale=1.0).sampling(
        fake_model(FakeNetwork(), "broken")
    )
    predictions = torch.zeros_like(sampling.take(4).u_t)
    predictions[row, 5] = value

    with pytest.raises(PlanningError, match="broken/1 predicts what is not finite"):
        sampling.give(predictions)


@pytest.mark.parametrize(("solver", "steps"), [("ddim", 41), ("dpm_solver", 20)])
def test_more_steps_than_the_model_has_times_are_refused_at_the_start(
    solver: Solver, steps: int
) -> None:
    with pytest.raises(InvalidStepCount):
        Asked(solver=solver, steps=steps).sampling(fake_model(FakeNetwork()))


def test_controls_are_in_the_natural_units_of_the_problem_s_plant() -> None:
    lopsided = System(control_limit=ControlLimits(-2.0, 6.0))
    limits = dict.fromkeys(("lowest_control", "highest_control"), (-10.0, 10.0))
    anywhere = Coverage(Coverage.only(System()).ranges | limits)
    model = fake_model(FakeNetwork(), coverage=anywhere)
    asked = Asked(guidance_scale=1.0)
    noise = asked.noise

    def controls(system: System) -> FloatArray:
        problem = Problem(np.zeros(2), np.array([0.2, 0.0]), system, HORIZON)
        return finish(Sampling(Job(0), model, problem, noise, asked.sampler))

    unit = controls(System(control_limit=1.0))

    assert unit.dtype == np.float64
    assert 0.1 < np.abs(unit).max() <= 1.0
    np.testing.assert_array_equal(controls(System()), 0.9 * unit)
    np.testing.assert_array_equal(controls(lopsided), 2.0 + 4.0 * unit)
    np.testing.assert_array_equal(noise, asked.noise)


ONE_STEP = Samplers(*(SamplerSettings(1, 1.0, first_time=1.0, last_time=0.0) for _ in range(2)))


class Denoiser:
    """Predicts what the clean sequence of a half makes of any prediction."""

    def __init__(self, predicts: str, alphas_cumprod: Sequence[float]) -> None:
        self._predicts = predicts
        self._alphas = torch.tensor(alphas_cumprod)

    def embed(self, _: Tensor) -> Tensor:
        return torch.zeros(2, 1)

    def predict(self, u_t: Tensor, t: Tensor, _: Tensor) -> Tensor:
        alpha = self._alphas[t].unsqueeze(1)
        clean = torch.full_like(u_t, 0.5)
        noise = (u_t - alpha.sqrt() * clean) / (1 - alpha).sqrt()
        velocity = alpha.sqrt() * noise - (1 - alpha).sqrt() * clean
        return {"noise": noise, "clean": clean, "velocity": velocity}[self._predicts]


@every_solver
@pytest.mark.parametrize("predicts", ["noise", "clean", "velocity"])
def test_a_prediction_is_taken_for_what_the_manifest_says_it_is(
    solver: Solver, predicts: str
) -> None:
    alphas = fake_model(FakeNetwork()).manifest.alphas_cumprod
    model = fake_model(Denoiser(predicts, alphas), predicts=predicts)

    controls = finish(Asked(solver=solver).sampling(model))

    np.testing.assert_allclose(controls, 0.5 * System().plant.highest_control, rtol=0, atol=1e-4)


@every_solver
def test_a_regression_sees_no_noise_and_answers_with_one_plan(solver: Solver) -> None:
    network = Denoiser("clean", [0.001])
    model = fake_model(
        network, kind="regression", alphas_cumprod=(0.001,), predicts="clean", samplers=ONE_STEP
    )
    asked = Asked(solver=solver, steps=1, guidance_scale=1.0)
    seen: list[FloatArray] = []

    sampling = Sampling(
        Job(0), model, asked.problem, asked.noise, Sampler(solver, ONE_STEP.ddim), seen.append
    )
    controls = finish(sampling)

    assert not seen[0].any()
    np.testing.assert_allclose(controls, 0.5 * System().plant.highest_control, rtol=1e-6)


def test_the_times_are_those_of_the_model_s_sampler() -> None:
    settings = SamplerSettings(steps=4, guidance_scale=1.0, first_time=0.5, last_time=0.125)
    network = FakeNetwork()
    model = fake_model(network, samplers=Samplers(settings, settings))
    asked = Asked()
    sampler = ActionDiffusion().settled(model.manifest.samplers)

    finish(Sampling(Job(0), model, asked.problem, asked.noise, sampler))

    assert [t[0].item() for _, t, _ in network.batches] == [20, 15, 10, 5]
