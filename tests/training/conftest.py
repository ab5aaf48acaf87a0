"""The smallest configuration that trains, and the road to variations of it."""

from collections.abc import Callable
from typing import Any, TypeAlias

import matplotlib as mpl
import pytest

from training.config import TrainingConfig

Configure: TypeAlias = Callable[..., TrainingConfig]
"""configure(name=value, section={...}): the tiny configuration with these changes."""

mpl.use("Agg")

TINY: dict[str, Any] = {
    "name": "tiny",
    "version": 1,
    "seed": 0,
    "system": {},
    "prior": {},
    "data": {
        "horizon": 16,
        "training_samples": 100,
        "validation_samples": 50,
        "position_range": [-1.0, 1.0],
        "velocity_range": [-0.5, 0.5],
    },
    "network": {"channels": 8, "time_dimension": 8, "condition_dimension": 8},
    "diffusion": {"num_timesteps": 20, "drop_probability": 0.2},
    "optimisation": {
        "steps": 12,
        "batch_size": 32,
        "learning_rate": 2e-3,
        "ema_decay": 0.9,
        "validation_interval": 5,
    },
}


@pytest.fixture(scope="session")
def configure() -> Configure:
    def configure(**changes: Any) -> TrainingConfig:
        values = {
            name: value | changes.get(name, {})
            if isinstance(value, dict)
            else changes.get(name, value)
            for name, value in TINY.items()
        }
        return TrainingConfig.model_validate(values)

    return configure
