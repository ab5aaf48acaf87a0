"""What a network knows of a problem: some of its numbers, by name, standardised.

A feature is a function of the problem; which ones a model takes, its manifest says.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveFloat, model_validator

from app.planning.arrays import FloatArray
from app.planning.problem import Problem

Feature: TypeAlias = Callable[[Problem], float]

FEATURES: dict[str, Feature] = {
    "initial_position": lambda problem: float(problem.initial_state[0]),
    "initial_velocity": lambda problem: float(problem.initial_state[1]),
    "target_position": lambda problem: float(problem.target_state[0]),
    "target_velocity": lambda problem: float(problem.target_state[1]),
}
"""m and m/s."""
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
        unknown = sorted(set(self.features) - FEATURES.keys())
        if unknown:
            raise ValueError(f"no features {', '.join(unknown)}; there are: {', '.join(FEATURES)}")
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

    def standardise(self, values: FloatArray) -> NDArray[np.float32]:
        """Return features (..., C) as the network takes them: (value - mean) / std."""
        standardised: FloatArray = (values - np.array(self.mean)) / np.array(self.std)
        return standardised.astype(np.float32)

    def encode(self, problem: Problem) -> NDArray[np.float32]:
        """Return the condition (C,) of a problem."""
        return self.standardise(np.array([FEATURES[name](problem) for name in self.features]))
