"""The manifest that travels beside every checkpoint: what `training` writes and the service reads.

No torch in here: models can be listed and checked without loading it.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveFloat, PositiveInt

from app.planning.plant.system import System

CHECKPOINT_FILE = "unet.pt"
MANIFEST_FILE = "manifest.json"

ModelName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$")]


class Losses(BaseModel):
    """Mean-squared error of the predicted noise (paper, Eq. 3) at the end of training."""

    training: FiniteFloat
    validation: FiniteFloat


class Manifest(BaseModel):
    """All that the service must know of a checkpoint beside its weights."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    format_version: Literal[1] = 1
    name: ModelName
    version: PositiveInt
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """Of the checkpoint file."""
    system: System
    horizon: PositiveInt
    control_scale: PositiveFloat
    """Network controls in [-1, 1] times this are m/s^2."""
    state_mean: tuple[FiniteFloat, FiniteFloat]
    state_std: tuple[PositiveFloat, PositiveFloat]
    """A state enters the network as (state - mean) / std."""
    alphas_cumprod: Annotated[
        tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(min_length=1, max_length=10_000)
    ]
    """Cumulative products of alpha_t for t = 0 ... T-1 (paper, Eq. 2)."""
    training: dict[str, Any]
    """The training configuration."""
    seeds: dict[str, int]
    losses: Losses
    libraries: dict[str, str]

    @classmethod
    def read(cls, path: Path) -> "Manifest":
        """Read a manifest.

        Raises:
            OSError: the file cannot be read.
            pydantic.ValidationError: it is not a manifest.
        """
        return cls.model_validate_json(path.read_bytes())
