"""The suites, a file each."""

from app.client.evaluation.suite import Suite
from app.client.evaluation.suites.error_compute import ErrorCompute
from app.client.evaluation.suites.friction_sensitivity import FrictionSensitivity
from app.client.evaluation.suites.learned_prior import LearnedPrior
from app.client.evaluation.suites.multistep_random import MultistepRandom
from app.client.evaluation.suites.multistep_reference import MultistepReference
from app.client.evaluation.suites.plant_sensitivity import PlantSensitivity
from app.client.evaluation.suites.random_targets import RandomTargets
from app.client.evaluation.suites.sample_budget import SampleBudget
from app.client.evaluation.suites.sampler_frontier import SamplerFrontier
from app.client.evaluation.suites.single_target import SingleTarget

SUITES: dict[str, type[Suite]] = {
    suite.name: suite
    for suite in (
        SingleTarget,
        SampleBudget,
        ErrorCompute,
        MultistepReference,
        MultistepRandom,
        FrictionSensitivity,
        RandomTargets,
        PlantSensitivity,
        LearnedPrior,
        SamplerFrontier,
    )
}
"""By name, in the order of the report."""
