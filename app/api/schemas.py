"""What travels over HTTP: requests and answers, for the service and the client alike."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    TypeAdapter,
)

from app.planning.methods import METHODS, ActionDiffusion, AnyMethod
from app.planning.objectives import Objective
from app.planning.problem import DEFAULT_HORIZON
from app.planning.refinement import Refinement
from app.planning.system import LARGEST, System

MAX_TARGETS = 64
MAX_SEED = 2**53 - 1
"""The largest integer that every JSON reader keeps exactly."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
State = Annotated[
    tuple[Number, Number],
    Field(description="Position (m) and velocity (m/s).", examples=[[0.2, 0.0]]),
]
Inclusion: TypeAlias = Literal["states", "candidates"]
MethodName: TypeAlias = Literal[
    "action_diffusion", "dataset_prior", "uniform", "cem", "icem", "mppi"
]
TaggedMethod = Annotated[AnyMethod, Field(discriminator="name")]
MethodField = Annotated[
    TaggedMethod,
    BeforeValidator(
        lambda value: {"name": value} if isinstance(value, str) else value,
        json_schema_input_type=MethodName | TaggedMethod,
    ),
    Field(description="A method's name, or an object with its name and options (see /methods)."),
]


class Initial(BaseModel):
    """Where an optimiser starts: the candidates of another method are its first population."""

    model_config = ConfigDict(extra="forbid")

    method: MethodField


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid")

    initial_state: State = Field(examples=[[0.0, 0.0]])
    method: MethodField = ActionDiffusion()
    num_candidates: Annotated[int, Field(strict=True, ge=1)] = Field(
        16, description="K: candidates that are rolled out and ranked."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=MAX_SEED)] | None = Field(
        None, description="Decides every random draw; without one the answer says which was drawn."
    )
    system: System | None = Field(
        None, description="The plant, where it is not the nominal one (or the named model's)."
    )
    horizon: Annotated[int, Field(strict=True, ge=1)] | None = Field(
        None, description=f"H, time steps; {DEFAULT_HORIZON} or the named model's by default."
    )
    model: str | None = Field(
        None,
        description="A model's name, or name/version; by default the one that fits the plant.",
        min_length=1,
        max_length=128,
    )
    initial: Initial | None = Field(
        None, description="Start an optimiser (cem, icem, mppi) from another method's candidates."
    )
    refine: Annotated[
        Refinement | None,
        BeforeValidator(
            lambda value: {True: {}, False: None}[value] if isinstance(value, bool) else value,
            json_schema_input_type=bool | Refinement | None,
        ),
    ] = Field(
        None,
        description="Descend from the candidates through the true dynamics: true, or options.",
    )
    objective: Objective = Field(
        "terminal_error",
        description="What ranks candidates that arrive equally well, and with `refine` what is "
        "lowered among the plans that arrive.",
    )
    deadline_ms: Annotated[int, Field(strict=True, ge=1)] | None = Field(
        None,
        description="Milliseconds from the request's arrival in which the answer is of use: what "
        "cannot be done by then is refused with 429, what runs out of time is dropped with 504. "
        "The service's own maximum by default (see /info).",
    )
    include: list[Inclusion] = Field(
        ["states"],
        description="What the answer holds beside controls and measures.",
        max_length=2,
    )


class PlanRequest(_Request):
    """One plan, from a start to a target."""

    target_state: State

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "initial_state": [0.0, 0.0],
                    "target_state": [0.2, 0.0],
                    "method": {
                        "name": "action_diffusion",
                        "sampler": "ddim",
                        "steps": 50,
                        "guidance_scale": 2.0,
                    },
                    "num_candidates": 16,
                    "seed": 7,
                }
            ]
        }
    )


class MultistepPlanRequest(_Request):
    """Plans to several targets, one after the other."""

    targets: list[State] = Field(min_length=1, max_length=MAX_TARGETS)

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "initial_state": [0.0, 0.0],
                    "targets": [[0.4, 0.0], [-0.4, 0.0], [0.2, 0.0]],
                    "method": "cem",
                    "num_candidates": 128,
                    "seed": 7,
                }
            ]
        }
    )


class ModelReference(BaseModel):
    """The checkpoint behind a plan."""

    model_config = ConfigDict(protected_namespaces=())

    name: str
    version: str
    sha256: str


class CostReport(BaseModel):
    """What a plan took."""

    network_evaluations: int = Field(
        description="Forward passes of the network, each over all candidates."
    )
    rollouts: int = Field(description="Control sequences rolled out over the whole horizon.")


class ReachabilityReport(BaseModel):
    """How near any plan could come to the target, by the physics alone."""

    reachable: bool = Field(description="Whether the floor is zero, to within rounding.")
    floor: float = Field(description="Least terminal error over all admissible controls.")
    nearest_state: tuple[float, float] = Field(description="A state at that distance.")
    minimum_steps: int | None = Field(
        None, description="Fewest steps in which the target can be reached; absent if it cannot."
    )


class RefinementReport(BaseModel):
    """What refinement did to the best terminal error."""

    error_before: float = Field(description="Of the best candidate as proposed.")
    error_after: float
    replaced: bool = Field(
        description="Whether a repair put another motion in the selected candidate's place."
    )


Milliseconds = Annotated[float, PlainSerializer(lambda value: round(value, 3))]
"""Sent to the microsecond: what lies below is noise."""


class TimingReport(BaseModel):
    """Wall-clock milliseconds in the server."""

    queue: Milliseconds = Field(description="Waiting for a free core or for the network.")
    propose: Milliseconds
    refine: Milliseconds
    rollout: Milliseconds = Field(description="Rolling out, ranking and measuring.")
    total: Milliseconds


class CandidatesReport(BaseModel):
    """All candidates, in the order in which they were proposed."""

    controls: list[list[float]] = Field(description="(K, H), m/s^2.")
    terminal_errors: list[float] = Field(description="(K,).")
    states: list[list[tuple[float, float]]] | None = Field(None, description="(K, H+1, 2).")


class Segment(BaseModel):
    """A plan: the best candidate, and the measures of that very rollout."""

    controls: list[float] = Field(description="u[0:H], m/s^2.")
    states: list[tuple[float, float]] | None = Field(
        None, description="(H+1, 2): position (m) and velocity (m/s)."
    )
    terminal_error: float = Field(description="||x_H - x*||_2.")
    gap: float = Field(description="Terminal error less its floor.")
    reachability: ReachabilityReport
    refinement: RefinementReport | None = Field(None, description="Absent without `refine`.")
    control_energy: float = Field(description="sum of u_k^2.")
    control_smoothness: float = Field(description="sum of (u_{k+1} - u_k)^2.")
    stuck_steps: int = Field(
        description="Steps at rest, below the threshold of static friction and off the target."
    )
    cost: CostReport
    timing_ms: TimingReport
    candidates: CandidatesReport | None = None


class _Provenance(BaseModel):
    method: str
    model: ModelReference | None = Field(None, description="Absent for methods that need no model.")
    seed: int
    system: System = Field(description="The plant that was planned for.")


class PlanResponse(Segment, _Provenance):
    """Answer to `POST /plan`."""


class MultistepPlanResponse(_Provenance):
    """Answer to `POST /plan_multistep`."""

    segments: list[Segment]
    controls: list[float] = Field(description="All segments' controls, (M*H,).")
    states: list[tuple[float, float]] | None = Field(None, description="(M*H+1, 2).")
    final_error: float = Field(description="Terminal error of the last segment.")
    mean_end_error: float = Field(description="Terminal error averaged over the segments.")
    mean_end_floor: float = Field(
        description="Floor of the terminal error averaged over the segments, each from its start."
    )
    stuck_steps: int
    cost: CostReport
    timing_ms: TimingReport


class Problem(BaseModel):
    """An error, as RFC 9457 describes it."""

    type: str
    title: str
    status: int
    detail: str
    instance: str = Field(description="The request's path.")
    errors: list["FieldError"] | None = Field(None, description="The fields at fault.")


class FieldError(BaseModel):
    """One field at fault."""

    pointer: str = Field(description="JSON pointer into the request body.")
    detail: str


class ModelDescription(BaseModel):
    """A model that the service holds."""

    name: str
    version: str
    sha256: str
    system: System
    horizon: int
    diffusion_timesteps: int
    validation_loss: float


class MethodDescription(BaseModel):
    """A planning method and its options."""

    name: str
    summary: str
    options: dict[str, Any] = Field(description="JSON schema of the method's object form.")


class Limits(BaseModel):
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
    max_deadline_ms: int


class Info(BaseModel):
    """What answers here."""

    name: str
    version: str
    machine: str = Field(description="Operating system, processor and usable cores.")
    device: str
    network_threads: int
    libraries: dict[str, str]
    nominal_system: System
    limits: Limits


class Health(BaseModel):
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
