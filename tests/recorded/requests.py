"""What the service is asked for the record: every method, refinement, objective and odd plant."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.evaluation.entrants import PAPER_MODEL

ANSWERS = Path(__file__).with_name("answers.jsonl")
"""Those on record, in the order of the requests."""

COMPILED_METHODS = ("dataset_prior", "uniform", "cem", "icem", "mppi")
OBJECTIVES = ("terminal_error", "control_energy", "control_smoothness", "stuck_steps")
PLANTS: tuple[dict[str, float], ...] = (
    {"static_friction": 0.85},
    {"static_friction": 0.0, "coulomb_friction": 0.0, "viscous_damping": 0.0},
    {"control_limit": 0.7},
    {"control_limit": 0.65},
    {"velocity_threshold": 0.2},
    {"viscous_damping": 15.0, "control_limit": 8.0},
    {"static_friction": 1.2, "coulomb_friction": 0.4, "viscous_damping": 2.7, "control_limit": 9.0},
    {"time_step": 0.01, "control_limit": 3.7, "static_friction": 0.3, "coulomb_friction": 0.2},
)


class Recorded(NamedTuple):
    """A request, and how near its answer has to be to the one on record."""

    path: str
    request: dict[str, Any]
    tolerance: float


def all_requests() -> Iterator[Recorded]:
    """List them, always the same."""
    tasks = _tasks(np.random.default_rng(0))
    for method, k in product(COMPILED_METHODS, (1, 16)):
        yield _plan(next(tasks), method=method, num_candidates=k)
    for objective, method in product(OBJECTIVES, ("dataset_prior", "uniform")):
        for k in (1, 8):
            yield _plan(
                next(tasks), method=method, num_candidates=k, refine=True, objective=objective
            )
    for system, method in product(PLANTS, ("dataset_prior", "cem")):
        yield _plan(next(tasks), method=method, system=system)
        yield _plan(next(tasks), method=method, system=system, refine=True)
    for refine in ({"repair": False}, {"iterations": 3}, {"num_refined": 2, "repair": True}):
        yield _plan(next(tasks), method="dataset_prior", num_candidates=8, refine=refine)
    for method, horizon in product(("dataset_prior", "icem"), (1, 7, 100)):
        yield _plan(next(tasks), method=method, horizon=horizon, refine=horizon > 1)
    options: tuple[dict[str, Any], ...] = (
        {"name": "dataset_prior", "prior": {"num_segments": 3, "kick_probability": 0.9,
                                            "medium_probability": 0.1}},
        {"name": "cem", "iterations": 5, "elite_fraction": 0.5, "initial_std": 0.5, "min_std": 0.1},
        {"name": "icem", "iterations": 5, "noise_exponent": 0.0, "momentum": 0.5},
        {"name": "mppi", "iterations": 5, "smoothing_window": 5, "temperature": 0.1},
    )  # fmt: skip
    for configured in options:
        yield _plan(
            next(tasks), method=configured, include=["states", "candidates"], num_candidates=4
        )
    for optimiser, initial in product(("cem", "icem", "mppi"), ("dataset_prior", "uniform")):
        yield _plan(next(tasks), method=optimiser, initial={"method": initial})
    for name, refined in product(("dataset_prior", "cem", "mppi"), (False, True)):
        yield _sequence(next(tasks), method=name, refine=refined)
    for model in (PAPER_MODEL, None):
        yield from _learned(tasks, model)
    systems: tuple[Any, ...] = ({"static_friction": 0.6}, {"static_friction": 0.8}, "emps", "servo")
    for system in systems:
        yield _plan(next(tasks), method="action_diffusion", system=system)


def _learned(tasks: Iterator[dict[str, Any]], model: str | None) -> Iterator[Recorded]:
    """Ask a model, by default the one that the service chooses."""
    asked = {"model": model} if model else {}
    for sampler, k in product(("dpm_solver", "ddim", "paper"), (1, 16)):
        method: dict[str, Any] = {"name": "action_diffusion", "sampler": sampler}
        yield _plan(next(tasks), method=method, num_candidates=k, **asked)
    for scale in (0.0, 1.0, 3.0):
        method = {"name": "action_diffusion", "steps": 2, "guidance_scale": scale}
        yield _plan(next(tasks), method=method, **asked)
    if model:
        for friction in (0.6, 0.8):
            yield _plan(next(tasks), method="action_diffusion", model=f"dry-friction-fs{friction}")
            yield _plan(
                next(tasks),
                method="action_diffusion",
                model=f"dry-friction-fs{friction}",
                system={"static_friction": friction},
            )
    yield _plan(next(tasks), method="cem", initial={"method": "action_diffusion"}, **asked)
    for objective in ("terminal_error", "control_energy"):
        yield _plan(
            next(tasks), method="action_diffusion", refine=True, objective=objective, **asked
        )
    for refine in (False, True):
        yield _sequence(next(tasks), method="action_diffusion", refine=refine, **asked)


def _tasks(rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Draw starts and targets, every other one at rest, and the request's seed."""
    while True:
        for moving in (0.0, 0.5):
            start, target, far = rng.uniform(-1, 1, 3)
            yield {
                "initial_state": [start, moving * rng.uniform(-1, 1)],
                "target_state": [target, moving * rng.uniform(-1, 1)],
                "far": [far, 0.0],
                "seed": int(rng.integers(2**32)),
            }


def _plan(task: dict[str, Any], **fields: Any) -> Recorded:
    del task["far"]
    return _recorded("/plan", task | {"include": []} | fields)


def _sequence(task: dict[str, Any], **fields: Any) -> Recorded:
    task["targets"] = [task.pop("target_state"), task.pop("far")]
    return _recorded("/plan_multistep", task | {"include": []} | fields)


def _recorded(path: str, request: dict[str, Any]) -> Recorded:
    """Learned plans keep to what the last bits of a network make of them, elsewhere too."""
    return Recorded(path, request, 1e-4 if "action_diffusion" in str(request) else 1e-9)
