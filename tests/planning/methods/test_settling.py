"""From what is asked for to what can propose: with a model where one is needed, and not without."""

import numpy as np
import pytest

from app.planning.methods import (
    CEM,
    METHODS,
    ActionDiffusion,
    AnyMethod,
    DatasetPrior,
    Learned,
    WarmStarted,
)
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, PAPER_SAMPLER
from app.planning.methods.settling import able, needs_model, settled
from app.planning.problem import Problem
from tests.planning.fakes import NoiseAsControls

PROBLEM = Problem(np.zeros(2), np.array([0.2, 0.0]))
OTHERS = [kind for kind in METHODS if kind is not ActionDiffusion]
LEARNED = ActionDiffusion(sampler="paper")


@pytest.mark.parametrize("kind", OTHERS)
def test_a_method_without_a_model_is_settled_and_able_as_it_is(kind: type[AnyMethod]) -> None:
    asked = kind()

    assert not needs_model(asked)
    assert settled(asked, None) is asked
    assert able(settled(asked, None), None) is asked


def test_action_diffusion_is_settled_by_its_model_and_then_samples_from_it() -> None:
    proposal = NoiseAsControls()

    assert needs_model(LEARNED)
    sampler = settled(LEARNED, PAPER_MODEL_SAMPLERS)
    assert sampler == PAPER_SAMPLER
    assert able(sampler, proposal) == Learned(PAPER_SAMPLER, proposal)


def test_an_optimiser_needs_the_model_of_what_it_starts_from() -> None:
    asked = WarmStarted(CEM(iterations=2), LEARNED)

    assert needs_model(asked)
    assert not needs_model(WarmStarted(CEM(), DatasetPrior()))
    method = settled(asked, PAPER_MODEL_SAMPLERS)
    assert method == WarmStarted(CEM(iterations=2), PAPER_SAMPLER)
    assert method.cost(8) == PAPER_SAMPLER.cost(8) + CEM(iterations=2).cost(8)
    planned = able(method, NoiseAsControls()).propose(PROBLEM, 8, np.random.default_rng(0))
    assert planned.controls.shape == (8, 64)
    assert planned.queue_ms == 2.5


@pytest.mark.parametrize("asked", [LEARNED, WarmStarted(CEM(), LEARNED)])
def test_nothing_is_settled_without_the_model_that_it_needs(
    asked: ActionDiffusion | WarmStarted[ActionDiffusion],
) -> None:
    with pytest.raises(ValueError, match="action_diffusion samples from a model"):
        settled(asked, None)
