"""Refined plans from two network evaluations, in this process."""

from statistics import median
from time import perf_counter

import numpy as np

from app.evaluation.tasks import sequence_tasks
from app.inference.engine import EngineProposal
from app.inference.manifest import Manifest
from app.planning.methods import ActionDiffusion
from app.planning.planner import plan_multistep
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement

METHOD = ActionDiffusion(sampler="dpm_solver", steps=2, guidance_scale=1.0)
NUM_CANDIDATES = 4
SEQUENCES = 100


def quick_plans(proposal: EngineProposal, manifest: Manifest) -> str:
    """Plan the random multi-step task; return an item of a Markdown list."""
    errors, floors, times = [], [], []
    asked = Recipe(METHOD, NUM_CANDIDATES, Refinement(), reachability=True)
    recipe = asked.settled(manifest.samplers).able(proposal)
    for index, task in enumerate(sequence_tasks(SEQUENCES, seed=0)):
        targets = task["targets"]
        rng = np.random.default_rng(index)
        started = perf_counter()
        result = plan_multistep(
            Problem(np.zeros(2), np.zeros(2), horizon=manifest.horizon),
            [np.array(target) for target in targets],
            recipe,
            rng,
        )
        times.append((perf_counter() - started) * 1e3 / len(targets))
        errors.append(result.mean_end_error)
        floors.append(result.mean_end_floor or 0.0)
    return (
        f"- action_diffusion with {recipe.cost().network_evaluations} evaluations, "
        f"K = {NUM_CANDIDATES}, refined: {median(times):.2f} ms a plan; mean end error "
        f"{np.mean(errors):.4f}, floor {np.mean(floors):.4f} ({SEQUENCES} sequences of 3 targets)"
    )
