"""Requests: what a service is asked for."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
)
from typing_extensions import TypeAliasType

from app.planning.methods import METHODS, OPTIMISERS, ActionDiffusion, AnyMethod, WarmStarted
from app.planning.methods.base import Named
from app.planning.methods.optimiser import Optimiser
from app.planning.objectives import OBJECTIVES, ObjectiveName
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import LARGEST, System
from app.planning.problem import DEFAULT_HORIZON
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.wire.model import ARRAY, Asked
from app.wire.uncertainty import Uncertainty

MAX_TARGETS = 64
MAX_PENDING_CONTROLS = 1024
MAX_SEED = 2**53 - 1
"""The largest integer that every JSON reader keeps exactly."""

Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
State = Annotated[
    tuple[Number, Number],
    ARRAY,
    Field(description="Position (m) and velocity (m/s).", examples=[[0.2, 0.0]]),
]
Inclusion: TypeAlias = Literal[
    "states", "candidates", "candidate_errors", "reachable_set", "denoising", "ensemble"
]
MethodName = TypeAliasType(
    "MethodName",
    Annotated[
        str, WithJsonSchema({"enum": [method().name for method in METHODS], "type": "string"})
    ],
)
MachineName = TypeAliasType(
    "MachineName", Annotated[str, WithJsonSchema({"enum": list(MACHINES), "type": "string"})]
)
TaggedMethod = Annotated[AnyMethod, Field(discriminator="name")]
MethodField = Annotated[
    TaggedMethod,
    BeforeValidator(
        lambda value: {"name": value} if isinstance(value, str) else value,
        json_schema_input_type=MethodName | TaggedMethod,
    ),
    Field(description="A method's name, or an object with its name and options (see /methods)."),
]


def machine_by_name(value: Any) -> Any:
    """Return the plant of the machine that a string names.

    Raises:
        ValueError: there is no such machine.
    """
    if not isinstance(value, str):
        return value
    if value not in MACHINES:
        raise ValueError(f"no machine {value!r}; there are: {', '.join(map(repr, MACHINES))}")
    return MACHINES[value].system


Seed: TypeAlias = Annotated[int, Field(ge=0, le=MAX_SEED)]
SystemField: TypeAlias = Annotated[
    System | None,
    BeforeValidator(machine_by_name, json_schema_input_type=MachineName | System | None),
]
RefineField = Annotated[
    Refinement | None,
    BeforeValidator(
        lambda value: {True: {}, False: None}[value] if isinstance(value, bool) else value,
        json_schema_input_type=bool | Refinement | None,
    ),
]


class Initial(Asked):
    """Where an optimiser starts: the candidates of another method are its first population."""

    method: MethodField


InitialState: TypeAlias = Annotated[
    State,
    Field(
        description="Position (m) and velocity (m/s) now: before the pending controls, if there "
        "are any.",
        examples=[[0.0, 0.0]],
    ),
]


class Shared(Asked):
    """How to plan, whatever the problem."""

    pending_controls: Annotated[list[Number], ARRAY] = Field(
        [],
        description="Controls that are on their way to the actuator already, oldest first, in "
        "units of control and within the plant's limits, a time step each. The plan starts from "
        "the state that they lead to.",
        max_length=MAX_PENDING_CONTROLS,
    )
    method: MethodField = Field(
        default_factory=ActionDiffusion,
        # By its name: generators of clients know no default that is an object.
        json_schema_extra={"default": ActionDiffusion().name},
    )
    num_candidates: Annotated[int, Field(ge=1)] = Field(
        16, description="K: candidates that are rolled out and ranked."
    )
    seed: Seed | None = Field(
        None, description="Decides every random draw; without one the answer says which was drawn."
    )
    system: SystemField = Field(
        None,
        description="The plant, where it is not the nominal one (or the named model's): its "
        "parameters, or the name of a machine (see /machines).",
    )
    horizon: Annotated[int, Field(ge=1)] | None = Field(
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
    refine: RefineField = Field(
        None,
        description="Descend from the candidates through the true dynamics: true, or options.",
    )
    objective: ObjectiveName = Field(
        "terminal_error",
        description="What ranks candidates that arrive equally well, and with `refine` what is "
        "lowered among the plans that arrive: stuck steps by moving at once and waiting at the "
        "target, where that is at rest.",
    )
    uncertainty: Uncertainty | None = Field(
        None,
        description="Plan for a plant that is not known: candidates are ranked by their risk over "
        "all plants that may be the true one, with `refine` plans are sought that come near on all "
        "of them, and the answer has a `robustness`. `objective` then decides ties only.",
    )
    reachability: bool = Field(
        True,
        description="Say how near any plan could come: the floor of the error, and the plan's gap "
        "to it. Without them a plan takes less time.",
    )
    deadline_ms: Annotated[int, Field(ge=1)] | None = Field(
        None,
        description="Milliseconds from the request's arrival in which the answer is of use: what "
        "cannot be done by then is refused with 429, what runs out of time is dropped with 504. "
        "The service's own maximum by default (see /info).",
    )
    include: Annotated[list[Inclusion], ARRAY] = Field(
        ["states"],
        description="What the answer holds beside controls and measures: the `states` of all that "
        "is sent, the `candidates` or only their errors, the outline of the `reachable_set`, every "
        "step of the `denoising` (of action_diffusion), and what the plan does on the `ensemble` "
        "of `uncertainty`.",
        max_length=6,
    )

    @field_validator("initial")
    @classmethod
    def _only_optimisers_start_from_something(
        cls, initial: Initial | None, checked: ValidationInfo
    ) -> Initial | None:
        method = checked.data.get("method")
        if initial and method and not isinstance(method, Optimiser):
            startable = ", ".join(optimiser().name for optimiser in OPTIMISERS)
            raise ValueError(f"{method.name} starts from nothing; {startable} can be started")
        return initial

    def recipe(self) -> Recipe[Named]:
        """Return how to plan; a learned method still lacks its model, which settles it."""
        method: Named = self.method
        if self.initial and isinstance(self.method, Optimiser):
            method = WarmStarted(self.method, self.initial.method)
        return Recipe(
            method,
            self.num_candidates,
            self.refine,
            OBJECTIVES[self.objective],
            self.reachability,
            outline="reachable_set" in self.include,
        )


class PlanRequest(Shared):
    """One plan, from a start to a target."""

    initial_state: InitialState
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


class MultistepPlanRequest(Shared):
    """Plans to several targets, one after the other."""

    initial_state: InitialState
    targets: Annotated[list[State], ARRAY] = Field(min_length=1, max_length=MAX_TARGETS)

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
