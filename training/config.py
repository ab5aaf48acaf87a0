"""The training configuration: the default one, and TOML files that say what differs from it."""

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt, model_validator

from app.inference.manifest import ModelName, Prediction
from app.inference.noise_levels import ModelKind
from app.planning.methods.sampler import Samplers
from app.planning.plant.system import System
from app.planning.prior import ControlPrior
from training.experts import Experts
from training.machines import RandomMachines
from training.section import Bounds, Probability, Section

DEFAULT_CONFIG = Path(__file__).with_name("default.toml")

LEAST_SHARE = 0.02
"""Of the learning rate, to which the cosine takes it down."""

Horizon: TypeAlias = Annotated[int, Field(ge=4, multiple_of=2)]
"""The U-Net halves it once, and normalises over what is left."""


class TransitionsConfig(Section):
    """The paper's data: how many transitions of `system`, from which initial states (uniform)."""

    kind: Literal["transitions"]
    horizon: Horizon
    training_samples: PositiveInt
    validation_samples: PositiveInt
    position_range: Bounds
    velocity_range: Bounds


class PlansConfig(Section):
    """Plans for random machines, made while the network trains on those of before."""

    kind: Literal["plans"]
    horizon: Horizon
    validation_samples: PositiveInt
    plans_at_once: PositiveInt
    """A chunk: made by one thread, and with its mirror images the smallest part of the pool."""
    chunks_in_pool: PositiveInt
    """A batch is drawn from so many chunks, the latest ones."""
    steps_per_chunk: PositiveInt
    """After so many steps a new chunk takes the place of the oldest."""
    machines: RandomMachines
    experts: Experts


class UNetConfig(Section):
    """Widths of the U-Net (paper, Tables 1 and 2)."""

    kind: Literal["unet"]
    channels: Annotated[int, Field(gt=0, multiple_of=8)]
    time_dimension: Annotated[int, Field(gt=0, multiple_of=2)]
    condition_dimension: PositiveInt


class MLPConfig(Section):
    """Sizes of the residual MLP."""

    kind: Literal["mlp"]
    width: PositiveInt
    blocks: PositiveInt
    time_dimension: Annotated[int, Field(gt=0, multiple_of=2)]


class DiffusionConfig(Section):
    """What the model is, T of its schedule, and the probability that a condition is dropped."""

    kind: ModelKind
    """A diffusion has the cosine schedule, a flow straight paths; a regression sees no noise, and
    has one time."""
    num_timesteps: Annotated[int, Field(ge=1, le=10_000)]
    drop_probability: Probability
    predicts: Prediction
    """What the network is trained to predict: the noise (the paper), the clean controls, or the
    velocity between them."""

    @model_validator(mode="after")
    def _goes_together(self) -> "DiffusionConfig":
        if (self.kind == "regression") != (self.num_timesteps == 1):
            raise ValueError("num_timesteps is 1 for a regression, and more for all others")
        if self.kind == "regression" and self.predicts != "clean":
            raise ValueError("a regression predicts the clean controls")
        return self


class OptimisationConfig(Section):
    """Adam on the mean-squared error, with an exponential moving average of the weights."""

    steps: PositiveInt
    batch_size: PositiveInt
    learning_rate: PositiveFloat
    decay: Literal["none", "cosine"]
    """Of the learning rate, down to `LEAST_SHARE` of it."""
    ema_decay: Probability
    max_gradient_norm: PositiveFloat | None = None
    """Longer gradients are shortened to it; the paper's are not."""
    terminal_weight: NonNegativeFloat
    """Of the terminal loss beside the mean-squared error."""
    validation_interval: PositiveInt

    def learning_rate_at(self, step: int) -> float:
        """Return the learning rate of a step (from 0)."""
        if self.decay == "none":
            return self.learning_rate
        share = 0.5 * (1 + math.cos(math.pi * step / self.steps))
        return self.learning_rate * (LEAST_SHARE + (1 - LEAST_SHARE) * share)


class TrainingConfig(Section):
    """Everything that decides the weights of a model; the seed decides all that is random."""

    name: ModelName
    version: PositiveInt
    start: Annotated[str, Field(pattern=r"^([a-z0-9._-]+/[1-9][0-9]*)?$")] = ""
    """`name/version` of a shipped model with whose weights training starts; random ones where it is
    empty. What that model was not told of a task has no weight at first."""
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    system: System
    """The plant; of a model for many, the one that a request is for which names none."""
    prior: ControlPrior
    data: Annotated[TransitionsConfig | PlansConfig, Field(discriminator="kind")]
    network: Annotated[UNetConfig | MLPConfig, Field(discriminator="kind")]
    diffusion: DiffusionConfig
    optimisation: OptimisationConfig
    samplers: Samplers
    """What the model's samplers do where a request does not say it; no matter of training."""

    @model_validator(mode="after")
    def _goes_together(self) -> "TrainingConfig":
        optimisation, data = self.optimisation, self.data
        if isinstance(data, TransitionsConfig):
            if optimisation.batch_size > data.training_samples:
                raise ValueError("batch_size must not exceed training_samples")
            if optimisation.terminal_weight:
                raise ValueError('terminal_weight is for data of the kind "plans"')
        return self

    def same_training(self) -> str:
        """Return all that decides the weights, as JSON."""
        return self.model_dump_json(exclude={"samplers"})

    @classmethod
    def read(cls, path: Path) -> "TrainingConfig":
        """Read a TOML file: a name, and whatever differs from another configuration.

        That is the file which it names as its `base`, in the same folder, or else the default one.
        A section of another kind than the base's has to be whole.

        Raises:
            OSError: the file, or its base, cannot be read.
            tomllib.TOMLDecodeError: it is not TOML.
            pydantic.ValidationError: the name is missing, or a value is unknown or out of range.
        """
        base, own = _base_and_own(path)
        del base["name"]
        return cls.model_validate(_varied(base, own))


def _base_and_own(
    path: Path, above: tuple[Path, ...] = ()
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a file's base says, with all that it is based on, and what the file says.

    A base that is one of those `above` stays in what the file says, where nobody knows it.
    """
    own = _load(path)
    base = path.parent / str(own.get("base"))
    if "base" not in own or base in (*above, path):
        return _load(DEFAULT_CONFIG), own
    del own["base"]
    return _varied(*_base_and_own(base, (*above, path))), own


def _load(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        return tomllib.load(file)


def _varied(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """Return a configuration with what a file says in place of what its base says."""
    sections = {
        name: section | own[name]
        for name, section in base.items()
        if isinstance(section, dict) and _is_a_variant(own.get(name), section)
    }
    return base | own | sections


def _is_a_variant(own: Any, section: dict[str, Any]) -> bool:
    """Say whether a file's section says what differs from its base's `section`."""
    kind = section.get("kind")
    return isinstance(own, dict) and own.get("kind", kind) == kind
