"""The smallest configurations that train, and the road to variations of them."""

from collections.abc import Callable
from typing import Any, TypeAlias

import matplotlib as mpl
import pytest

from training.config import TrainingConfig

Configure: TypeAlias = Callable[..., TrainingConfig]
"""configure(name=value, section={...}): the tiny configuration with these changes."""

mpl.use("Agg")

SAMPLER = {"guidance_scale": 1.0, "first_time": 1.0, "last_time": 0.0}
TINY: dict[str, Any] = {
    "name": "tiny",
    "version": 1,
    "seed": 0,
    "system": {},
    "prior": {},
    "data": {
        "kind": "transitions",
        "horizon": 16,
        "training_samples": 100,
        "validation_samples": 50,
        "position_range": [-1.0, 1.0],
        "velocity_range": [-0.5, 0.5],
    },
    "network": {"kind": "unet", "channels": 8, "time_dimension": 8, "condition_dimension": 8},
    "diffusion": {
        "kind": "diffusion",
        "num_timesteps": 20,
        "drop_probability": 0.2,
        "predicts": "noise",
    },
    "optimisation": {
        "steps": 12,
        "batch_size": 32,
        "learning_rate": 2e-3,
        "decay": "none",
        "ema_decay": 0.9,
        "terminal_weight": 0.0,
        "validation_interval": 5,
    },
    "samplers": {
        "dpm_solver": SAMPLER | {"steps": 3},
        "ddim": SAMPLER | {"steps": 10},
    },
}
PLANS: dict[str, Any] = {
    "kind": "plans",
    "horizon": 16,
    "validation_samples": 30,
    "plans_at_once": 40,
    "chunks_in_pool": 3,
    "steps_per_chunk": 4,
    "machines": {},
    "experts": {
        "rollout": 0.5,
        "exact": 0.0,
        "least_energy": 0.4,
        "margin": 0.1,
        "static_margin": 0.1,
        "num_candidates": 1,
    },
}
"""The data of a model for many machines."""
ANY_MACHINE: dict[str, Any] = {
    "data": PLANS,
    "network": {"kind": "mlp", "width": 16, "blocks": 2, "time_dimension": 8},
    "diffusion": {"predicts": "clean"},
    "optimisation": {"terminal_weight": 1.0, "decay": "cosine"},
}
"""configure(**ANY_MACHINE) trains such a model."""


@pytest.fixture(scope="session")
def configure() -> Configure:
    def configure(**changes: Any) -> TrainingConfig:
        return TrainingConfig.model_validate(
            {name: _changed(value, changes.get(name, {})) for name, value in TINY.items()}
        )

    return configure


def _changed(value: Any, change: Any) -> Any:
    if not isinstance(value, dict):
        return change or value
    kind = value.get("kind")
    return value | change if change.get("kind", kind) == kind else change
