"""The messages of a control session, as JSON texts over a WebSocket; an answer for each message."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, TypeAdapter

from app.planning.control import RecedingHorizon
from app.planning.plant.system import System
from app.wire.control import (
    BY_ITS_NAME,
    PLANNED_FOR,
    Carry,
    ControllerField,
    EstimateReport,
    PendingControls,
    RestingState,
    Status,
    StepsLeft,
    StepTiming,
)
from app.wire.model import ARRAY, Asked, WireModel
from app.wire.problems import FieldError
from app.wire.requests import Number, Seed, SystemField
from app.wire.uncertainty import Ensemble

MAX_STEP_DEADLINE_MS = 60_000.0

Told: TypeAlias = Literal["estimate", "plan", "carry"]


class Start(Asked):
    """Begin to control a machine, or go on where another session ended."""

    type: Literal["start"] = "start"
    target_state: RestingState
    system: SystemField = None
    controller: ControllerField = Field(
        default_factory=RecedingHorizon, json_schema_extra=BY_ITS_NAME
    )
    uncertainty: Ensemble | None = Field(None, description=PLANNED_FOR)
    seed: Seed | None = Field(None, description="Decides the plants of `uncertainty`.")
    steps_left: StepsLeft | None = Field(
        None, description="Counted from the first measurement on; the session counts down."
    )
    pending_controls: PendingControls = Field(
        [],
        description="On their way to the actuator at the first measurement, oldest first; as many "
        "as its delay has steps. The session adds each control that it gives.",
    )
    resume: Carry | None = Field(None, description="The last carry of a session that ended.")
    deadline_ms: Annotated[float, Field(gt=0, le=MAX_STEP_DEADLINE_MS)] | None = Field(
        None, description="A control that comes later says so; by default the time step."
    )
    include: Annotated[list[Told], ARRAY] = Field(
        ["estimate"], description="What comes with each control.", max_length=3
    )


class Measure(Asked):
    """What is measured now: it is answered by a control."""

    type: Literal["measure"] = "measure"
    position: Number = Field(description="m.")
    velocity: Number | None = Field(None, description="m/s, where it is measured.")
    step: Annotated[int, Field(ge=0)] | None = Field(
        None, description="Which one it is, from 0 on; another one than is due is refused."
    )


class Target(Asked):
    """Another target from the next measurement on, moving or not."""

    type: Literal["target"] = "target"
    target_state: RestingState
    steps_left: StepsLeft | None = None


class Stop(Asked):
    """End the session."""

    type: Literal["stop"] = "stop"


AskedMessage: TypeAlias = Start | Measure | Target | Stop
ASKED: TypeAdapter[AskedMessage] = TypeAdapter(Annotated[AskedMessage, Field(discriminator="type")])


class Started(WireModel):
    """The session has begun."""

    type: Literal["started"]
    controller: str
    system: System
    seed: int | None = Field(None, description="Absent where nothing was drawn.")
    deadline_ms: float


class Control(WireModel):
    """What to send to the machine now."""

    type: Literal["control"]
    step: int = Field(description="The measurement that it answers, from 0 on.")
    control: float
    status: Status
    late: bool = Field(description="Whether it comes later than the deadline of a step.")
    timing_ms: StepTiming
    estimate: EstimateReport | None = None
    plan: list[float] | None = None
    carry: Carry | None = None


class Targeted(WireModel):
    """The target has changed."""

    type: Literal["targeted"]
    step: int = Field(description="The first one towards it.")


class Ended(WireModel):
    """The session is over, stopped, idle or drained; another one can go on from here."""

    type: Literal["ended"]
    reason: Literal["stopped", "idle", "draining"]
    step: int = Field(description="Measurements that were answered.")
    late_steps: int
    target_state: tuple[float, float] | None = None
    steps_left: int | None = None
    pending_controls: list[float] | None = None
    carry: Carry | None = Field(None, description="For `resume`; absent if it never began.")


class Failed(WireModel):
    """A message is at fault; the session goes on as if it had not come.

    problem+json whose `type` is `problem`, for `type` says what kind of message it is.
    """

    type: Literal["error"]
    problem: str
    title: str
    status: int
    detail: str
    instance: str
    errors: list[FieldError] | None = None


ToldMessage: TypeAlias = Started | Control | Targeted | Ended | Failed
TOLD: TypeAdapter[ToldMessage] = TypeAdapter(Annotated[ToldMessage, Field(discriminator="type")])
