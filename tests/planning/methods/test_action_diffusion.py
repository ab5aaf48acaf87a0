"""Action Diffusion: what its options ask of the model, and what that costs."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion, Learned
from app.planning.methods.base import Finish
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Sampler, Samplers, SamplerSettings
from app.planning.problem import Candidates, Cost, Problem

PROBLEM = Problem(np.zeros(2), np.array([0.2, 0.0]), horizon=48)
OTHER_SAMPLERS = Samplers(
    dpm_solver=SamplerSettings(2, 1.0, first_time=1.0, last_time=0.125),
    ddim=SamplerSettings(4, 3.0, first_time=0.75, last_time=0.25),
)
"""Of a model that is not the paper's."""


@dataclass
class Recorder:
    calls: list[tuple[Problem, FloatArray, Sampler]] = field(default_factory=list)

    def begin(self, problem: Problem, noise: FloatArray, sampler: Sampler) -> Finish:
        self.calls.append((problem, noise, sampler))
        return lambda: Candidates(0.1 * noise, queue_ms=1.0)


def test_the_sampler_and_standard_normal_noise_reach_the_model() -> None:
    model = Recorder()
    sampler = ActionDiffusion(steps=12, guidance_scale=3.5).settled(PAPER_MODEL_SAMPLERS)

    proposal = Learned(sampler, model).propose(PROBLEM, 400, np.random.default_rng(0))

    ((problem, noise, asked),) = model.calls
    assert problem is PROBLEM
    assert asked is sampler
    assert noise.shape == (400, 48)
    assert noise.mean() == pytest.approx(0.0, abs=0.02)
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    np.testing.assert_array_equal(proposal.controls, 0.1 * noise)
    assert proposal.queue_ms == 1.0


@pytest.mark.parametrize(
    ("options", "samplers", "solver", "settings", "evaluations"),
    [
        (ActionDiffusion(), PAPER_MODEL_SAMPLERS, "dpm_solver", (3, 2.0, 0.7, 0.25), 6),
        (ActionDiffusion(), OTHER_SAMPLERS, "dpm_solver", (2, 1.0, 1.0, 0.125), 2),
        (ActionDiffusion(sampler="ddim"), PAPER_MODEL_SAMPLERS, "ddim", (10, 1.5, 1.0, 0.0), 20),
        (ActionDiffusion(sampler="ddim"), OTHER_SAMPLERS, "ddim", (4, 3.0, 0.75, 0.25), 8),
        (ActionDiffusion(sampler="paper"), PAPER_MODEL_SAMPLERS, "ddim", (50, 2.0, 1.0, 0.0), 100),
        (ActionDiffusion(sampler="paper"), OTHER_SAMPLERS, "ddim", (50, 2.0, 1.0, 0.0), 100),
        (ActionDiffusion(steps=7), PAPER_MODEL_SAMPLERS, "dpm_solver", (7, 2.0, 0.7, 0.25), 14),
        (ActionDiffusion(steps=7), OTHER_SAMPLERS, "dpm_solver", (7, 1.0, 1.0, 0.125), 7),
        (
            ActionDiffusion(sampler="ddim", guidance_scale=0.0),
            OTHER_SAMPLERS,
            "ddim",
            (4, 0.0, 0.75, 0.25),
            4,
        ),
        (
            ActionDiffusion(steps=5, guidance_scale=2.0),
            OTHER_SAMPLERS,
            "dpm_solver",
            (5, 2.0, 1.0, 0.125),
            10,
        ),
    ],
)
def test_what_is_left_open_is_settled_by_the_model_but_for_the_sampler_of_the_paper(
    options: ActionDiffusion,
    samplers: Samplers,
    solver: str,
    settings: tuple[int, float, float, float],
    evaluations: int,
) -> None:
    sampler = options.settled(samplers)

    assert sampler.solver == solver
    assert sampler.settings == SamplerSettings(*settings)
    assert Learned(sampler, Recorder()).cost(4) == sampler.cost(4)
    assert sampler.cost(4).network_evaluations == evaluations


@pytest.mark.parametrize("options", [{"steps": 50}, {"guidance_scale": 2.0}, {"steps": 10}])
def test_the_sampler_of_the_paper_is_not_to_be_changed(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"the paper's sampler has its own .*; use ddim"):
        ActionDiffusion(sampler="paper", **options)


@pytest.mark.parametrize(
    ("guidance_scale", "predictions"), [(0.0, 1), (0.5, 2), (1.0, 1), (2.0, 2)]
)
def test_the_cost_counts_both_predictions_where_there_are_two(
    guidance_scale: float, predictions: int
) -> None:
    options = ActionDiffusion(steps=20, guidance_scale=guidance_scale)

    assert options.settled(OTHER_SAMPLERS).cost(512) == Cost(
        network_evaluations=20 * predictions, predictions_per_step=predictions
    )


def test_with_a_model_it_goes_by_its_own_name() -> None:
    sampler = ActionDiffusion().settled(OTHER_SAMPLERS)

    assert Learned(sampler, Recorder()).name == sampler.name == ActionDiffusion().name


@pytest.mark.parametrize(
    ("field", "value"),
    [("steps", 0), ("guidance_scale", 20.1), ("first_time", 1.1), ("last_time", -0.1)],
)
def test_settings_out_of_their_range_are_refused(field: str, value: float) -> None:
    settings: dict[str, Any] = {
        "steps": 3, "guidance_scale": 1.0, "first_time": 0.8, "last_time": 0.1, field: value
    }  # fmt: skip
    with pytest.raises(ValueError, match=field):
        SamplerSettings(**settings)


def test_times_that_rise_are_refused() -> None:
    with pytest.raises(ValueError, match="times fall"):
        SamplerSettings(3, 1.0, first_time=0.2, last_time=0.3)
