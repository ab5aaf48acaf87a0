"""One step of a closed loop: what is asked, and what is answered.

The messages of a session are in sessions.py, whole runs in simulation.py.
"""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)
from typing_extensions import TypeAliasType

from app.planning.control import CONTROLLERS, AnyController, RecedingHorizon
from app.planning.plant.system import System
from app.wire.model import ARRAY, Asked, WireModel
from app.wire.requests import (
    MAX_PENDING_CONTROLS,
    MethodField,
    Number,
    RefineField,
    Seed,
    State,
    SystemField,
)
from app.wire.uncertainty import Ensemble

MAX_STEPS_LEFT = 1_000_000

Status: TypeAlias = Literal["moving", "holding", "arrived", "unreachable"]
ControllerName = TypeAliasType(
    "ControllerName",
    Annotated[
        str,
        WithJsonSchema(
            {"enum": [controller().name for controller in CONTROLLERS], "type": "string"}
        ),
    ],
)
TaggedController = Annotated[AnyController, Field(discriminator="name")]
ControllerField = Annotated[
    TaggedController,
    BeforeValidator(
        lambda value: {"name": value} if isinstance(value, str) else value,
        json_schema_input_type=ControllerName | TaggedController,
    ),
    Field(description="A controller's name, or an object with its name and options."),
]
BY_ITS_NAME: dict[str, Any] = {"default": RecedingHorizon().name}
"""Generators of clients know no default that is an object."""


def _at_rest(state: tuple[float, float]) -> tuple[float, float]:
    if state[1] != 0.0:
        raise ValueError("a closed loop comes to rest: the velocity of its target must be 0")
    return state


RestingState = Annotated[
    State,
    AfterValidator(_at_rest),
    Field(description="Position (m) to come to rest at; the velocity is 0."),
]
StepsLeft = Annotated[int, Field(ge=0, le=MAX_STEPS_LEFT)]
PendingControls = Annotated[
    list[Number],
    ARRAY,
    Field(
        description="Controls that are on their way to the actuator already, oldest first, in "
        "units of control and within the plant's limits: what is chosen now acts after them.",
        max_length=MAX_PENDING_CONTROLS,
    ),
]
PLANNED_FOR = (
    "Plants that may be the true one: the receding horizon plans for all of them, the mean of "
    "their squared errors, in place of `system` with what was learned."
)
Carry = Annotated[
    dict[str, Any],
    Field(description="What the last step gave, as it came: plan, observer and estimate."),
]


class Fallback(Asked):
    """Another way to plan, where no plan of the receding horizon's own arrives."""

    method: MethodField
    num_candidates: Annotated[int, Field(ge=1)] = Field(
        16, description="Candidates that are rolled out and ranked."
    )
    refine: RefineField = Field(
        None, description="Descend from the candidates to a plan that arrives: true, or options."
    )


class ControlRequest(Asked):
    """One step of a closed loop: what is measured, and what the step before left."""

    state: State | None = Field(
        None, description="Position (m) and velocity (m/s), as they are measured now."
    )
    position: Number | None = Field(
        None, description="Position (m) in place of a state, where velocities are not measured."
    )
    target_state: RestingState = Field(examples=[[0.2, 0.0]])
    system: SystemField = Field(
        None,
        description="What is believed of the plant: its parameters, or the name of a machine.",
    )
    controller: ControllerField = Field(
        default_factory=RecedingHorizon, json_schema_extra=BY_ITS_NAME
    )
    steps_left: StepsLeft | None = Field(
        None,
        description="Time steps until the mass has to rest at the target, counted from the "
        "control that is asked for; without them, and at 0, as early as possible.",
    )
    pending_controls: PendingControls = Field([])
    carry: Carry | None = Field(
        None,
        description="What the last step's answer gave, as it came: plan, observer and estimate. "
        "Without it nothing was learned so far, as in a first step.",
    )
    uncertainty: Ensemble | None = Field(None, description=PLANNED_FOR)
    fallback: Fallback | None = Field(
        None,
        description="Plan by another method as well, where no plan of the receding horizon's own "
        "arrives; not with `uncertainty`.",
    )
    seed: Seed | None = Field(
        None,
        description="Decides the draws of a fallback, and the plants of `uncertainty`: the same in "
        "every step of a loop. A step without either draws nothing.",
    )
    deadline_ms: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Milliseconds in which the answer is of use, as for /plan."
    )

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"state": [0.0, 0.0], "target_state": [0.2, 0.0], "steps_left": 64}]
        }
    )

    @model_validator(mode="after")
    def _is_measured_once(self) -> "ControlRequest":
        if (self.state is None) == (self.position is None):
            raise ValueError("either state or position says what is measured")
        return self


class EstimateReport(WireModel):
    """What a controller believes: where the mass is, and which plant it moves."""

    position: float = Field(description="m.")
    velocity: float = Field(description="m/s.")
    position_std: float = Field(description="Standard deviation, m; 0 without an observer.")
    velocity_std: float = Field(description="m/s; 0 without an observer.")
    system: System = Field(
        description="The plant with what was learned of it; of static friction the middle of what "
        "it can be."
    )
    gain_std: float = Field(description="Standard deviation of the control gain, relative.")
    coulomb_std: float = Field(description="Relative.")
    damping_std: float = Field(description="Relative.")
    bias_std: float = Field(description="m/s^2.")
    static_forward: tuple[float, float] = Field(
        description="Static friction forward: at least and at most, m/s^2."
    )
    static_backward: tuple[float, float] = Field(description="The same, backward.")


class StepTiming(WireModel):
    """Wall-clock milliseconds in the server."""

    queue: float = Field(description="Waiting for a thread.")
    step: float
    total: float


class ControlResponse(WireModel):
    """Answer to `POST /control`."""

    controller: str
    system: System = Field(description="What was believed of the plant.")
    seed: int | None = Field(None, description="Absent where nothing was drawn.")
    control: float = Field(description="To be sent now, units of control.")
    plan: list[float] = Field(description="This control, and those that are to follow it.")
    predicted_states: list[tuple[float, float]] = Field(
        description="Of the plan on the plant as it is believed, from the state after the pending "
        "controls on: position (m) and velocity (m/s)."
    )
    predicted_error: float | None = Field(
        None,
        description="Terminal error of a plan that was made in this step, m; with `uncertainty` "
        "before it was made for all plants.",
    )
    status: Status = Field(
        description="moving; holding: at rest for this step, short of the target; arrived: at "
        "rest in the dead band; unreachable: no plan that was found gets there, in time."
    )
    estimate: EstimateReport
    carry: Carry
    timing_ms: StepTiming
