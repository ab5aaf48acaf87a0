"""The suites, a file each."""

from app.evaluation.suite import Suite
from app.evaluation.suites.any_machine import AnyMachine
from app.evaluation.suites.closed_loop import ClosedLoop
from app.evaluation.suites.error_compute import ErrorCompute
from app.evaluation.suites.friction_sensitivity import FrictionSensitivity
from app.evaluation.suites.identification import Identification
from app.evaluation.suites.learned_models import LearnedModels
from app.evaluation.suites.learned_prior import LearnedPrior
from app.evaluation.suites.multistep_random import MultistepRandom
from app.evaluation.suites.multistep_reference import MultistepReference
from app.evaluation.suites.plant_sensitivity import PlantSensitivity
from app.evaluation.suites.random_machines import RandomMachines
from app.evaluation.suites.random_targets import RandomTargets
from app.evaluation.suites.robust import Robust
from app.evaluation.suites.sample_budget import SampleBudget
from app.evaluation.suites.sampler_frontier import SamplerFrontier
from app.evaluation.suites.single_target import SingleTarget

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
        RandomMachines,
        AnyMachine,
        PlantSensitivity,
        Robust,
        Identification,
        ClosedLoop,
        LearnedPrior,
        LearnedModels,
        SamplerFrontier,
    )
}
"""By name, in the order of the report."""
