"""What a network knows of a task: some of its numbers, by name, standardised.

Which features a model takes, its manifest says; what they are, `app.planning.plant.features`.
"""

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveFloat, model_validator

from app.planning.arrays import FloatArray
from app.planning.plant.features import (
    PLANT_FEATURES,
    SPREAD_FEATURES,
    TASK_FEATURES,
    feature_values,
)
from app.planning.plant.spread import CERTAIN, Spread
from app.planning.plant.task import Task

STATES = ("initial_position", "initial_velocity", "target_position", "target_velocity")
"""The paper's condition, c = [x_0, x*]."""


class Conditioning(BaseModel):
    """The condition c of a model: C features, each with its mean and standard deviation."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    features: Annotated[tuple[str, ...], Field(min_length=1)]
    mean: tuple[FiniteFloat, ...]
    std: tuple[PositiveFloat, ...]

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        known = TASK_FEATURES.keys() | PLANT_FEATURES.keys() | SPREAD_FEATURES.keys()
        unknown = sorted(set(self.features) - known)
        if unknown:
            raise ValueError(
                f"no features {', '.join(unknown)}; there are: "
                f"{', '.join((*TASK_FEATURES, *PLANT_FEATURES, *SPREAD_FEATURES))}"
            )
        if not len(self.features) == len(self.mean) == len(self.std):
            raise ValueError("features, mean and std must be equally many")
        return self

    @classmethod
    def on_states(cls, mean: Sequence[float], std: Sequence[float]) -> Self:
        """Return the paper's condition, both states standardised alike.

        Args:
            mean: of position and velocity, (2,).
            std: the same.
        """
        return cls(features=STATES, mean=(*mean, *mean), std=(*std, *std))

    @property
    def size(self) -> int:
        """C."""
        return len(self.features)

    def encode_tasks(
        self, task: Task, horizon: int, spread: Spread = CERTAIN
    ) -> NDArray[np.float32]:
        """Return the conditions (N, C) of tasks: (value - mean) / std of each feature.

        Args:
            task: the fields of it and of its plant are floats or (N,).
            horizon: H.
            spread: by how much the plant may be off; the same.
        """
        values = feature_values(self.features, task, horizon, spread)
        standardised: FloatArray = (values - np.array(self.mean)) / np.array(self.std)
        return standardised.astype(np.float32)
