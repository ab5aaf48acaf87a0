"""What the sections of a training configuration have in common."""

from typing import Annotated, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class Section(BaseModel):
    """A part of a configuration: unknown names and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if not bounds[0] < bounds[1]:
        raise ValueError("a range is [low, high] with low < high")
    return bounds


Bounds: TypeAlias = Annotated[tuple[float, float], AfterValidator(_ordered)]
"""Least and greatest value."""
Share: TypeAlias = Annotated[float, Field(ge=0, le=1)]
Probability: TypeAlias = Annotated[float, Field(ge=0, lt=1)]
