"""Action Diffusion: what its options ask of the model, and what that costs."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion, Learned
from app.planning.problem import Candidates, Cost, Problem

PROBLEM = Problem(np.zeros(2), np.array([0.2, 0.0]), horizon=48)


@dataclass
class Recorder:
    calls: list[dict[str, Any]] = field(default_factory=list)

    def sample(
        self, problem: Problem, noise: FloatArray, solver: str, steps: int, guidance_scale: float
    ) -> Candidates:
        self.calls.append(
            {
                "problem": problem,
                "noise": noise,
                "solver": solver,
                "steps": steps,
                "guidance_scale": guidance_scale,
            }
        )
        return Candidates(0.1 * noise, queue_ms=1.0)


def test_the_options_and_standard_normal_noise_reach_the_model() -> None:
    model = Recorder()
    method = Learned(ActionDiffusion(steps=12, guidance_scale=3.5), model)

    proposal = method.propose(PROBLEM, 400, np.random.default_rng(0))

    (call,) = model.calls
    assert call["problem"] is PROBLEM
    assert (call["solver"], call["steps"], call["guidance_scale"]) == ("dpm_solver", 12, 3.5)
    assert call["noise"].shape == (400, 48)
    assert call["noise"].mean() == pytest.approx(0.0, abs=0.02)
    assert call["noise"].std() == pytest.approx(1.0, abs=0.02)
    np.testing.assert_array_equal(proposal.controls, 0.1 * call["noise"])
    assert proposal.queue_ms == 1.0


@pytest.mark.parametrize(
    ("options", "settings", "evaluations"),
    [
        (ActionDiffusion(), ("dpm_solver", 3, 2.0), 6),
        (ActionDiffusion(sampler="ddim"), ("ddim", 10, 1.5), 20),
        (ActionDiffusion(sampler="paper"), ("ddim", 50, 2.0), 100),
        (ActionDiffusion(steps=7), ("dpm_solver", 7, 2.0), 14),
        (ActionDiffusion(sampler="ddim", guidance_scale=0.0), ("ddim", 10, 0.0), 10),
        (ActionDiffusion(sampler="ddim", steps=5, guidance_scale=1.0), ("ddim", 5, 1.0), 5),
    ],
)
def test_what_is_left_open_is_settled_by_the_sampler(
    options: ActionDiffusion, settings: tuple[str, int, float], evaluations: int
) -> None:
    model = Recorder()
    method = Learned(options, model)

    method.propose(PROBLEM, 4, np.random.default_rng(0))

    (call,) = model.calls
    assert (call["solver"], call["steps"], call["guidance_scale"]) == settings
    assert options.settings == settings
    assert method.cost(4) == options.cost(4)
    assert method.cost(4).network_evaluations == evaluations


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
    method = ActionDiffusion(steps=20, guidance_scale=guidance_scale)

    assert method.cost(512) == Cost(
        network_evaluations=20 * predictions, predictions_per_step=predictions
    )


def test_with_a_model_it_goes_by_its_own_name() -> None:
    assert Learned(ActionDiffusion(), Recorder()).name == ActionDiffusion().name
