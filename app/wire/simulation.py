"""Whole runs on a machine that is not what its controller believes: asked and answered."""

from typing import Annotated, Literal, TypeAlias

from pydantic import ConfigDict, Field, model_validator

from app.planning.control import simulation as domain
from app.planning.control.memory import MAX_PLAN
from app.planning.control.observer import Noise
from app.planning.control.simulation import MAX_STEPS, Pulse, Sensor
from app.planning.plant.system import System
from app.wire.control import (
    ControllerField,
    RestingState,
    Status,
    StepsLeft,
)
from app.wire.model import ARRAY, Asked, WireModel
from app.wire.requests import MAX_PENDING_CONTROLS, MAX_SEED, Number, State, SystemField
from app.wire.uncertainty import Ensemble

MAX_RUNS = 10_000
MAX_PULSES = 64
Series: TypeAlias = Literal["states", "measurements", "estimates"]


class Disturbance(Asked):
    """Forces that no controller is told of."""

    acceleration_noise: Noise = Field(
        0.0, description="m/s^2, the standard deviation; drawn anew for each step."
    )
    pulses: Annotated[list[Pulse], ARRAY] = Field(
        [], description="Forces that push for a while.", max_length=MAX_PULSES
    )

    @property
    def made(self) -> domain.Disturbance:
        """The same as the domain has it."""
        return domain.Disturbance(self.acceleration_noise, tuple(self.pulses))


class SimulateRequest(Asked):
    """Runs of a controller, or of a control sequence, on a true plant."""

    initial_state: State = Field(examples=[[0.0, 0.0]])
    system: SystemField = Field(
        None, description="The true plant: its parameters, or the name of a machine."
    )
    controls: Annotated[list[Number], ARRAY] | None = Field(
        None,
        description="Open loop: a control sequence, after which the mass is left alone.",
        min_length=1,
        max_length=MAX_PLAN,
    )
    controller: ControllerField | None = Field(None, description="Closed loop.")
    target_state: RestingState | None = Field(
        None, description="Where a controller is to come to rest; by it runs are judged."
    )
    nominal_system: SystemField = Field(
        None,
        description="What the controller believes of the plant, `system` by default: of the same "
        "time step and control limits.",
    )
    uncertainty: Ensemble | None = Field(
        None, description="Plants around `nominal_system` that the controller is to plan for."
    )
    steps: Annotated[int, Field(ge=1, le=MAX_STEPS)] | None = Field(
        None, description="Time steps of a run; 128, or as many as there are controls."
    )
    steps_left: StepsLeft | None = Field(
        None, description="When the mass has to rest at the target; as early as it can by default."
    )
    disturbance: Disturbance | None = Field(
        None, description="Forces that the controller is not told of."
    )
    sensor: Sensor | None = Field(
        None, description="What is measured, and how well; exactly everything by default."
    )
    delay_steps: Annotated[int, Field(ge=0, le=MAX_PENDING_CONTROLS)] = Field(
        0, description="Time steps that a control takes to the actuator."
    )
    knows_delay: bool = Field(True, description="Whether the controller is told of the delay.")
    num_runs: Annotated[int, Field(ge=1, le=MAX_RUNS)] = Field(
        1, description="Runs that differ in noise and disturbance: of seed, seed + 1, ..."
    )
    seed: Annotated[int, Field(ge=0, le=MAX_SEED - MAX_RUNS)] | None = Field(
        None,
        description="Decides noise and disturbance, alike for every controller, and the plants of "
        "`uncertainty`; without one the answer says which was drawn.",
    )
    deadline_ms: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Milliseconds in which the answer is of use, as for /plan."
    )
    include: Annotated[list[Series], ARRAY] = Field(
        ["states", "measurements"],
        description="What the answer has of each run beside controls and measures.",
        max_length=3,
    )

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "initial_state": [0.0, 0.0],
                    "target_state": [0.2, 0.0],
                    "system": {"static_friction": 0.8, "coulomb_friction": 0.65},
                    "nominal_system": {"static_friction": 0.7, "coulomb_friction": 0.6},
                    "controller": "receding_horizon",
                    "steps_left": 64,
                    "disturbance": {"acceleration_noise": 0.05},
                    "sensor": {"position_noise": 0.001, "velocity_noise": 0.01},
                    "num_runs": 2,
                    "seed": 7,
                }
            ]
        }
    )

    @model_validator(mode="after")
    def _one_loop_with_its_target(self) -> "SimulateRequest":
        if (self.controls is None) == (self.controller is None):
            raise ValueError("either controls or controller says what is done")
        if self.controller is not None and self.target_state is None:
            raise ValueError("a controller needs a target_state")
        return self


class RunReport(WireModel):
    """One run: what was done, and what came of it."""

    seed: int
    controls: list[float] = Field(description="As they were asked for, units of control.")
    states: list[tuple[float, float]] | None = Field(
        None, description="The true ones, one more than steps: position (m) and velocity (m/s)."
    )
    measurements: list[tuple[float, float | None]] | None = Field(
        None, description="The same as measured; null where velocities are not."
    )
    estimates: list[tuple[float, float]] | None = Field(
        None, description="What the observer made of them, a step each."
    )
    final_state: tuple[float, float]
    final_error: float | None = Field(
        None, description="Distance from the target in the end, m; absent without a target."
    )
    settling_step: int | None = Field(
        None,
        description="The first step from which the mass stays within 1 cm of the target; absent "
        "if there is none.",
    )
    hunting: bool = Field(description="Whether the mass moves in 8 or more of the last 32 steps.")
    control_energy: float = Field(description="sum of u_k^2, (units of control)^2.")
    status: Status | None = Field(
        None, description="What the controller said at last; absent of an open loop."
    )


class SimulationTiming(WireModel):
    """Wall-clock milliseconds in the server."""

    queue: float
    simulate: float
    total: float


class SimulateResponse(WireModel):
    """Answer to `POST /simulate`."""

    controller: str = Field(description="Its name; controls of an open loop.")
    system: System = Field(description="The true plant.")
    nominal_system: System = Field(description="What the controller believed.")
    seed: int
    runs: list[RunReport]
    timing_ms: SimulationTiming

    @property
    def control_unit(self) -> str:
        """The unit of control, as far as the plant itself says it."""
        return "m/s²" if self.system.control_gain == 1 else "units of control"
