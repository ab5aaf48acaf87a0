"""What a service says about itself: its models, methods and limits."""

from typing import Any, Literal

from pydantic import Field, TypeAdapter

from app.planning.methods import METHODS
from app.planning.plant.plant_range import PlantRange
from app.planning.plant.system import System
from app.wire.model import WireModel


class ModelDescription(WireModel):
    """A model that the service holds."""

    name: str
    version: str
    sha256: str
    plants: PlantRange = Field(description="Least and greatest value of each parameter.")
    horizon: int
    diffusion_timesteps: int
    validation_loss: float

    def covers(self, system: System, horizon: int) -> bool:
        """Say whether the model was trained for such a plant and horizon."""
        return self.plants.covers(system) and self.horizon == horizon


class MethodDescription(WireModel):
    """A planning method and its options."""

    name: str
    summary: str
    options: dict[str, Any] = Field(description="JSON schema of the method's object form.")


class Limits(WireModel):
    """The largest requests that this service takes."""

    max_body_bytes: int
    max_candidates: int
    max_targets: int
    max_horizon: int
    max_network_rows: int
    max_rollout_steps: int
    max_candidate_steps: int
    max_answer_numbers: int
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
