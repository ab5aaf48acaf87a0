"""The training configuration: the default one, and TOML files that say what differs from it."""

import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, model_validator

from app.inference.manifest import ModelName
from app.planning.plant.system import System
from app.planning.prior import ControlPrior

DEFAULT_CONFIG = Path(__file__).with_name("default.toml")

Probability = Annotated[float, Field(ge=0, lt=1)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class DataConfig(_Section):
    """How many transitions, of which horizon, from which initial states (uniform)."""

    horizon: Annotated[int, Field(ge=4, multiple_of=2)]
    """The U-Net halves it once, and normalises over what is left."""
    training_samples: PositiveInt
    validation_samples: PositiveInt
    position_range: tuple[float, float]
    velocity_range: tuple[float, float]

    @model_validator(mode="after")
    def _ranges_are_ordered(self) -> "DataConfig":
        for low, high in (self.position_range, self.velocity_range):
            if not low < high:
                raise ValueError("a range is [low, high] with low < high")
        return self


class NetworkConfig(_Section):
    """Widths of the U-Net (paper, Tables 1 and 2)."""

    channels: Annotated[int, Field(gt=0, multiple_of=8)]
    time_dimension: Annotated[int, Field(gt=0, multiple_of=2)]
    condition_dimension: PositiveInt


class DiffusionConfig(_Section):
    """T of the cosine schedule, and the probability that a condition is dropped."""

    num_timesteps: Annotated[int, Field(ge=2, le=10_000)]
    drop_probability: Probability


class OptimisationConfig(_Section):
    """Adam on the noise-prediction loss, with an exponential moving average of the weights."""

    steps: PositiveInt
    batch_size: PositiveInt
    learning_rate: PositiveFloat
    ema_decay: Probability
    validation_interval: PositiveInt


class TrainingConfig(_Section):
    """Everything that decides the weights of a model; the seed decides all that is random."""

    name: ModelName
    version: PositiveInt
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    system: System
    prior: ControlPrior
    data: DataConfig
    network: NetworkConfig
    diffusion: DiffusionConfig
    optimisation: OptimisationConfig

    @model_validator(mode="after")
    def _a_batch_fits(self) -> "TrainingConfig":
        if self.optimisation.batch_size > self.data.training_samples:
            raise ValueError("batch_size must not exceed training_samples")
        return self

    @classmethod
    def read(cls, path: Path) -> "TrainingConfig":
        """Read a TOML file: a name, and whatever differs from the default configuration.

        Raises:
            OSError: the file cannot be read.
            tomllib.TOMLDecodeError: it is not TOML.
            pydantic.ValidationError: the name is missing, or a value is unknown or out of range.
        """
        default = tomllib.loads(DEFAULT_CONFIG.read_text())
        del default["name"]
        with path.open("rb") as file:
            own = tomllib.load(file)
        sections = {
            name: section | own[name]
            for name, section in default.items()
            if isinstance(section, dict) and isinstance(own.get(name), dict)
        }
        return cls.model_validate(default | own | sections)
