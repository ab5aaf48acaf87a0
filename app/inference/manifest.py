"""The manifest that travels beside every checkpoint: what `training` writes and the service reads.

No torch in here: models can be listed and checked without loading it.
"""

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    model_validator,
)

from app.inference.conditioning import Conditioning
from app.inference.diffusion_times import diffusion_times
from app.inference.noise_levels import ModelKind
from app.planning.methods.base import InvalidStepCount
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Samplers, SamplerSettings
from app.planning.plant.coverage import Coverage
from app.planning.plant.natural_units import natural_units
from app.planning.plant.spread import CERTAIN, Spread
from app.planning.plant.system import System
from app.planning.problem import Problem

CHECKPOINT_FILE = "unet.pt"
MANIFEST_FILE = "manifest.json"

SpreadParameter: TypeAlias = Literal[
    "static_friction", "coulomb_friction", "viscous_damping", "control_gain"
]
"""The fields of `Spread`."""
ModelName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$")]
Prediction: TypeAlias = Literal["noise", "clean", "velocity"]
"""What a network predicts of u_t = signal * clean + noise * eps: eps, the clean sequence, or how
fast u_t changes on the way to noise: of a diffusion signal * eps - noise * clean (Salimans and Ho
2022), of a flow eps - clean."""


class Losses(BaseModel):
    """At the end of training: mean-squared error of the prediction (of the noise: paper, Eq. 3).

    With the terminal loss, where the configuration gives that a weight.
    """

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
    alphas_cumprod: Annotated[
        tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(min_length=1, max_length=10_000)
    ]
    """Cumulative products of alpha_t for t = 0 ... T-1 (paper, Eq. 2): the share of the signal in
    the squares of signal and noise."""
    training: dict[str, Any]
    """The training configuration."""
    seeds: dict[str, int]
    losses: Losses
    libraries: dict[str, str]


class Manifest(_AnyManifest):
    """All that the service must know of a checkpoint beside its weights.

    The network's controls are in the natural units of the problem's plant: -1 is its lowest
    control, 1 its highest.
    """

    format_version: Literal[2] = 2
    coverage: Coverage
    """What the model was trained for: plants, and how far the tasks go that are put to it."""
    system: System
    """The plant of a request that names the model and no plant."""
    trained_on: Annotated[str, Field(min_length=1, max_length=1000)]
    """In words, for whoever lists the models."""
    kind: ModelKind = "diffusion"
    condition: Conditioning
    uncertainty: dict[SpreadParameter, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    """By what share each parameter of a plant may be off at most; a model that was trained for
    plants which may is told by how much."""
    predicts: Prediction
    samplers: Samplers

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if not self.covers(self.system, self.horizon):
            raise ValueError("the coverage does not cover the model's own system")
        for sampler in (self.samplers.dpm_solver, self.samplers.ddim):
            try:
                self.times(sampler)
            except InvalidStepCount as error:
                raise ValueError(f"samplers: {error}") from error
        return self

    @cached_property
    def label(self) -> str:
        """`name/version`, as requests name it."""
        return f"{self.name}/{self.version}"

    def is_called(self, reference: str) -> bool:
        """Say whether a request that names `reference` may mean this model."""
        return reference in (self.name, self.label)

    def covers(self, system: System, horizon: int) -> bool:
        """Say whether the model was trained for such a plant and horizon."""
        return self.horizon == horizon and self.coverage.covers(system, horizon)

    def times(self, sampler: SamplerSettings) -> list[int]:
        """Return the diffusion times of a sampler; errors as for `diffusion_times`."""
        return diffusion_times(
            len(self.alphas_cumprod), sampler.steps, sampler.first_time, sampler.last_time
        )

    @property
    def knows_uncertainty(self) -> bool:
        """Whether the model makes other plans for a plant that may be off."""
        return bool(self.uncertainty)

    def encode(self, problem: Problem, spread: Spread = CERTAIN) -> NDArray[np.float32]:
        """Return what the network knows of a problem, (C,), or of the nearest one covered."""
        task = self.coverage.nearest(problem.task, self.horizon)
        nearest = spread.within(Spread(**self.uncertainty))
        condition: NDArray[np.float32]
        (condition,) = self.condition.encode_tasks(task, self.horizon, nearest)
        return condition

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
    control_scale: PositiveFloat
    """Network controls in [-1, 1] times this are m/s^2."""
    state_mean: tuple[FiniteFloat, FiniteFloat]
    state_std: tuple[PositiveFloat, PositiveFloat]
    """A state enters the network as (state - mean) / std."""

    @model_validator(mode="after")
    def _scales_to_the_limit(self) -> Self:
        units = natural_units(self.system.plant)
        if (units.middle, units.control) != (0.0, self.control_scale):
            raise ValueError("control_scale must be the system's control_limit")
        return self

    def upgraded(self) -> Manifest:
        """Return the same in the present format."""
        replaced = {"format_version", "system", "control_scale", "state_mean", "state_std"}
        return Manifest(
            **self.model_dump(exclude=replaced),
            coverage=Coverage.only(self.system),
            system=self.system,
            trained_on="Rollouts of random controls, drawn from the paper's prior, on this plant.",
            condition=Conditioning.on_states(self.state_mean, self.state_std),
            predicts="noise",
            samplers=PAPER_MODEL_SAMPLERS,
        )


_READER: TypeAdapter[Manifest | _ManifestVersion1] = TypeAdapter(
    Annotated[Manifest | _ManifestVersion1, Field(discriminator="format_version")]
)
