"""The manifest that travels beside every checkpoint: what `training` writes and the service reads.

No torch in here: models can be listed and checked without loading it.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    field_validator,
)

from app.inference.conditioning import Conditioning
from app.planning.plant.plant_range import PlantRange
from app.planning.plant.system import System

CHECKPOINT_FILE = "unet.pt"
MANIFEST_FILE = "manifest.json"

ModelName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$")]


class Losses(BaseModel):
    """Mean-squared error of the predicted noise (paper, Eq. 3) at the end of training."""

    training: FiniteFloat
    validation: FiniteFloat


class _AnyManifest(BaseModel):
    """What a manifest of every format version has."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    format_version: int
    name: ModelName
    version: PositiveInt
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """Of the checkpoint file."""
    horizon: PositiveInt
    control_scale: PositiveFloat
    """Network controls in [-1, 1] times this are m/s^2."""
    alphas_cumprod: Annotated[
        tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(min_length=1, max_length=10_000)
    ]
    """Cumulative products of alpha_t for t = 0 ... T-1 (paper, Eq. 2)."""
    training: dict[str, Any]
    """The training configuration."""
    seeds: dict[str, int]
    losses: Losses
    libraries: dict[str, str]


class Manifest(_AnyManifest):
    """All that the service must know of a checkpoint beside its weights."""

    format_version: Literal[2] = 2
    plants: PlantRange
    """That the model was trained for."""
    condition: Conditioning
    predicts: Literal["noise"] = "noise"

    @field_validator("plants")
    @classmethod
    def _offer_a_default(cls, plants: PlantRange) -> PlantRange:
        # A request that names the model and no plant is for this one: it has to be possible.
        plants.nearest(System())
        return plants

    @classmethod
    def read(cls, path: Path) -> "Manifest":
        """Read a manifest of any format version.

        Raises:
            OSError: the file cannot be read.
            pydantic.ValidationError: it is not a manifest.
        """
        manifest = _READER.validate_json(path.read_bytes())
        return manifest.upgraded() if isinstance(manifest, _ManifestVersion1) else manifest


class _ManifestVersion1(_AnyManifest):
    """The first format: one plant, conditions of states. It is read for ever."""

    format_version: Literal[1]
    system: System
    state_mean: tuple[FiniteFloat, FiniteFloat]
    state_std: tuple[PositiveFloat, PositiveFloat]
    """A state enters the network as (state - mean) / std."""

    def upgraded(self) -> Manifest:
        """Return the same in the present format."""
        replaced = {"format_version", "system", "state_mean", "state_std"}
        return Manifest(
            **self.model_dump(exclude=replaced),
            plants=PlantRange.only(self.system),
            condition=Conditioning.on_states(self.state_mean, self.state_std),
        )


_READER: TypeAdapter[Manifest | _ManifestVersion1] = TypeAdapter(
    Annotated[Manifest | _ManifestVersion1, Field(discriminator="format_version")]
)
