"""Identification: a log of a machine, and what a service makes of it."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, FailFast, Field, JsonValue
from typing_extensions import TypeAliasType

from app.planning.identification.identify import Question
from app.planning.identification.log_checks import LEAST_STEPS, LEAST_TIME_STEP, MOST_TIME_STEP
from app.planning.plant.system import (
    ByDirection,
    ControlLimits,
    NotNegative,
    Positive,
    System,
)
from app.planning.uncertainty.uncertainty import MAX_SYSTEMS
from app.wire.model import ARRAY, Asked, WireModel
from app.wire.requests import MAX_SEED, Number

MAX_SAMPLES = 50_000
MAX_DELAY_STEPS = 64
NUM_SYSTEMS = 32
Series = TypeAliasType("Series", Annotated[list[Number], ARRAY, FailFast()])
"""Of many numbers one that is wrong is told of."""
EXAMPLE_CONTROLS: list[JsonValue] = [
    control
    for control, steps in [
        (0.9, 8),
        (-0.5, 10),
        (0.0, 2),
        (-0.9, 8),
        (0.5, 10),
        (0.0, 2),
        (0.65, 2),
        (0.75, 8),
        (-0.3, 10),
        (-0.75, 8),
        (0.3, 8),
    ]
    for _ in range(steps)
]
# fmt: off
EXAMPLE_POSITIONS: list[JsonValue] = [
    0.0, 0.0007, 0.0023, 0.0045, 0.0075, 0.0112, 0.0157, 0.0209, 0.0268, 0.03, 0.0304,
    0.0305, 0.0304, 0.0304, 0.0304, 0.0304, 0.0304, 0.0304, 0.0305, 0.0305, 0.0304, 0.0297,
    0.0282, 0.026, 0.023, 0.0192, 0.0147, 0.0095, 0.0036, 0.0004, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0004, 0.0011, 0.0022, 0.0038, 0.0057, 0.0079,
    0.0105, 0.0134, 0.0141, 0.0141, 0.0142, 0.0141, 0.0141, 0.0142, 0.0142, 0.0141, 0.0141,
    0.0141, 0.0137, 0.0131, 0.0119, 0.0104, 0.0085, 0.0063, 0.0037, 0.0007, -0.0001, 0.0,
    0.0, 0.0, 0.0, 0.0001, 0.0, 0.0,
]
# fmt: on
"""Of the paper's plant, to 0.1 mm."""


class Known(Asked):
    """What is certain of the machine: fields of its `system`."""

    static_friction: NotNegative | ByDirection | None = Field(None, description="m/s^2.")
    coulomb_friction: NotNegative | ByDirection | None = Field(None, description="m/s^2.")
    viscous_damping: NotNegative | ByDirection | None = Field(None, description="1/s.")
    stribeck_velocity: Positive | None = Field(
        None, description="m/s; it is not identified: without it there is no Stribeck effect."
    )
    bias: Number | None = Field(None, description="m/s^2.")
    control_gain: Positive | None = Field(None, description="m/s^2 for each unit of control.")
    control_limit: Positive | ControlLimits | None = Field(
        None, description="Units of control; by default the largest control in the log, both ways."
    )
    velocity_threshold: Positive | None = Field(None, description="m/s.")

    @property
    def fields(self) -> dict[str, Any]:
        """Those that are said."""
        said = ((name, getattr(self, name)) for name in type(self).model_fields)
        return {name: value for name, value in said if value is not None}


class IdentifyRequest(Asked):
    """A log of one machine in motion, at even times."""

    time_step: Annotated[float, Field(ge=LEAST_TIME_STEP)] = Field(
        description="Between samples, s.",
        # A longer one is refused where it can be asked whether it is in ms.
        json_schema_extra={"maximum": MOST_TIME_STEP},
    )
    controls: Series = Field(
        description="Units of control; control k acts from sample k to k+1, or `delay_steps` "
        "later.",
        min_length=LEAST_STEPS,
        max_length=MAX_SAMPLES,
    )
    positions: Series = Field(
        description="m (or rad), as many as controls, or one more.",
        min_length=LEAST_STEPS,
        max_length=MAX_SAMPLES + 1,
    )
    velocities: Series | None = Field(
        None,
        description="m/s, as many as positions, if they are measured: not differences of them.",
        min_length=LEAST_STEPS,
        max_length=MAX_SAMPLES + 1,
    )
    known: Known = Field(
        default_factory=Known,
        description="What is certain and need not be identified.",
        json_schema_extra={"default": {}},
    )
    direction_dependent: bool | Literal["auto"] = Field(
        "auto", description="Whether frictions may differ by direction; auto lets the log say."
    )
    delay_steps: Annotated[int, Field(ge=0, le=MAX_DELAY_STEPS)] | Literal["auto"] = Field(
        "auto",
        description="Time steps that a control takes to the actuator; auto tries the first few.",
    )
    position_lag: Annotated[float, Field(ge=0, le=MOST_TIME_STEP)] | Literal["auto"] = Field(
        "auto",
        description="Measured positions are those of so long ago, s, at most a time step: half a "
        "step where a control is held from sample to sample and positions are read as it changes, "
        "as on most machines; 0 where the log is a simulation's that moves as `system` does. auto "
        "lets the log say which of the two.",
    )
    num_systems: Annotated[int, Field(ge=1, le=MAX_SYSTEMS)] = Field(
        NUM_SYSTEMS, description="Plants of the ensemble."
    )
    seed: Annotated[int, Field(ge=0, le=MAX_SEED)] | None = Field(
        None, description="Decides every random draw; without one the answer says which was drawn."
    )
    deadline_ms: Annotated[int, Field(ge=1)] | None = Field(
        None, description="As for plans: milliseconds in which the answer is of use."
    )
    include: Annotated[list[Literal["predictions"]], ARRAY] = Field(
        [], description="What the answer holds beside the plant.", max_length=1
    )

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "time_step": 0.05,
                    "controls": EXAMPLE_CONTROLS,
                    "positions": EXAMPLE_POSITIONS,
                    "known": {"control_limit": 0.9},
                    "seed": 7,
                }
            ]
        }
    )

    @property
    def question(self) -> Question:
        """What is asked, as the domain has it."""
        by_direction, delay, lag = self.direction_dependent, self.delay_steps, self.position_lag
        return Question(
            known=self.known.fields,
            by_direction=None if by_direction == "auto" else by_direction,
            delay_steps=None if delay == "auto" else delay,
            position_lag=None if lag == "auto" else lag,
            num_systems=self.num_systems,
        )


class ParameterReport(WireModel):
    """An estimate."""

    name: str = Field(
        description="A field of `system`, with .forward or .backward where it differs by direction."
    )
    value: float
    standard_error: float
    interval: tuple[float, float] = Field(description="95 %.")
    identifiable: bool = Field(description="Whether the log tells it.")
    why_not: str | None = Field(None, description="Why it does not, in words.")


class FitReport(WireModel):
    """How well the plant explains the log."""

    window_s: float = Field(description="How far ahead end positions are predicted, s.")
    end_error_rms: float = Field(description="Of these predictions, m.")
    r2: float = Field(
        description="The share of what the machine moves in a window that they explain; 1 is all."
    )
    residual: float = Field(
        description="Root mean square error of positions predicted one measurement ahead, m."
    )
    acceleration_noise: float = Field(
        description="What pushes the mass in each step beside control and friction: standard "
        "deviation, m/s^2."
    )
    position_noise: float = Field(description="Of the measurements: standard deviation, m.")
    velocity_noise: float | None = Field(None, description="The same of velocities, m/s.")
    condition_number: float = Field(
        description="Of the estimates' correlations: 1 if each can be told by itself."
    )
    moving_steps: int = Field(description="Steps in which the machine moved.")


class Predictions(WireModel):
    """Stretches of the log, one after the other, as the plant predicts each from its start."""

    first_samples: list[int] = Field(description="Where each begins, an index of the positions.")
    positions: list[list[float]] = Field(description="m, a row a stretch; `fit` tells of its end.")


class IdentificationTiming(WireModel):
    """Wall-clock milliseconds in the server."""

    queue: float = Field(description="Waiting for a free core.")
    identify: float
    total: float


class IdentifyResponse(WireModel):
    """Answer to `POST /identify`."""

    seed: int
    system: System = Field(description="The plant: what `/plan` takes.")
    parameters: list[ParameterReport] = Field(description="What was not known.")
    delay_steps: int
    position_lag: float = Field(
        description="Measured positions are those of so long ago, s; a controller's `observer` "
        "takes it."
    )
    systems: list[System] = Field(
        description="The ensemble, each as likely as another: what `uncertainty` takes."
    )
    fit: FitReport
    warnings: list[str]
    advice: list[str] = Field(description="What to record next.")
    predictions: Predictions | None = None
    timing_ms: IdentificationTiming
