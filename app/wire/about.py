"""What a service says about itself: its models, methods and limits."""

from typing import Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter

from app.planning.methods import METHODS
from app.planning.methods.sampler import Samplers
from app.planning.plant.coverage import Coverage
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import System
from app.wire.model import WireModel


class ModelDescription(WireModel):
    """A model that the service holds."""

    name: str
    version: str
    sha256: str
    trained_on: str = Field(description="In words.")
    plants: str = Field(description="Those that the model covers, in words.")
    coverage: Coverage = Field(
        description="The same as numbers: the least and greatest value of features of a plant. "
        "Ranges of features of the task refuse nothing: the network is asked for the nearest task "
        "within."
    )
    system: System = Field(description="The plant of a request that names the model and no plant.")
    horizon: int
    kind: str = Field("diffusion", description="What it is: a diffusion, a flow or a regression.")
    uncertainty: dict[str, float] = Field(
        {},
        description="By what share each parameter of the plant may be off at most, as the model "
        "was trained for; empty, it knows only plants that are known exactly.",
    )
    predicts: str = Field(description="What the network predicts: noise, clean or velocity.")
    samplers: Samplers = Field(
        description="What each sampler does where a request does not say it; times are shares of "
        "the diffusion times."
    )
    diffusion_timesteps: int
    validation_loss: float = Field(description="Mean-squared error of what the network predicts.")

    @property
    def label(self) -> str:
        """`name/version`, as requests name it."""
        return f"{self.name}/{self.version}"

    def covers(self, system: System, horizon: int) -> bool:
        """Say whether the model was trained for such a plant and horizon."""
        return self.horizon == horizon and self.coverage.covers(system, horizon)


class MethodDescription(WireModel):
    """A planning method and its options."""

    name: str
    summary: str
    options: dict[str, Any] = Field(description="JSON schema of the method's object form.")


class MachineDescription(WireModel):
    """A real machine that may be planned for by its name."""

    model_config = ConfigDict(from_attributes=True)

    name: str = Field(description="What `system` may be in a request.")
    title: str
    system: System
    position_unit: str = Field(description="Where it is rad, m is read as rad everywhere.")
    control_unit: str = Field(description="The machine's unit of control.")
    delay_steps: int = Field(
        description="Time steps that a control takes to the actuator: so many `pending_controls`."
    )
    source: str = Field(
        description="Who published the parameters, and what was assumed beside them."
    )


class Limits(WireModel):
    """The largest requests that this service takes."""

    max_body_bytes: int
    max_log_bytes: int
    max_log_samples: int
    max_batch_body_bytes: int
    max_problems: int
    max_candidates: int
    max_targets: int
    max_pending_controls: int
    max_horizon: int
    max_network_rows: int
    max_rollout_steps: int
    max_candidate_steps: int
    max_answer_numbers: int
    max_sessions: int
    max_pending: int
    max_pending_rows: int
    max_pending_rollout_steps: int
    max_pending_answer_bytes: int
    max_deadline_ms: int


class Info(WireModel):
    """What answers here."""

    name: str
    version: str
    machine: str = Field(description="Operating system, processor and usable cores.")
    device: str
    network_threads: int
    libraries: dict[str, str]
    nominal_system: System
    limits: Limits


class Health(WireModel):
    """A probe's answer."""

    status: Literal["alive", "ready"]


def describe_machines() -> list[MachineDescription]:
    """Describe every machine that a request may name."""
    return [MachineDescription.model_validate(machine) for machine in MACHINES.values()]


def describe_methods() -> list[MethodDescription]:
    """Describe every method with the schema that requests are checked against."""
    return [
        MethodDescription(
            name=method().name,
            summary=(method.__doc__ or "").split("\n")[0],
            options=TypeAdapter(method).json_schema(),
        )
        for method in METHODS
    ]
