"""Laws that know no plan: PD, PID, friction feedforward, and the time-optimal switching law.

What an engineer would use without a planner; the kernels of all of them.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from app.compilation import compiled
from app.planning.control.base import Law
from app.planning.control.memory import INTEGRAL, Memory
from app.planning.control.settings import FEEDBACK, SWITCHING, Settings
from app.planning.control.switching import braking_distance
from app.planning.plant.friction import acceleration, friction_of
from app.planning.plant.system import Plant

Gain = Annotated[float, Ge(0), Le(1e6)]
Share = Annotated[float, Ge(0), Le(10)]


@dataclass(frozen=True, slots=True)
class PD(Law):
    """Proportional-derivative feedback; the model's bias is compensated."""

    name: Literal["pd"] = "pd"
    proportional: Gain = 100.0
    """1/s^2: of the acceleration by the error."""
    derivative: Gain = 27.0
    """1/s: of the acceleration by the velocity."""

    def settings(self, model: Plant) -> Settings:
        return self._watching(model)._replace(
            kind=FEEDBACK, proportional=self.proportional, derivative=self.derivative
        )


@dataclass(frozen=True, slots=True)
class PID(Law):
    """PD with an integral of the error, which stands still while the control is at its limit."""

    name: Literal["pid"] = "pid"
    proportional: Gain = 130.0
    """1/s^2."""
    integral: Gain = 6.0
    """1/s^3."""
    derivative: Gain = 34.0
    """1/s."""

    def settings(self, model: Plant) -> Settings:
        return self._watching(model)._replace(
            kind=FEEDBACK,
            proportional=self.proportional,
            integral=self.integral,
            derivative=self.derivative,
        )


@dataclass(frozen=True, slots=True)
class PDFeedforward(Law):
    """PD that adds what the model says friction takes: static at rest, Coulomb in motion."""

    name: Literal["pd_feedforward"] = "pd_feedforward"
    proportional: Gain = 22.0
    """1/s^2."""
    derivative: Gain = 6.6
    """1/s."""
    feedforward: Share = 0.75
    """Of the model's friction."""
    slow: Gain = 5e-3
    """m/s: slower than this, static friction is fed forward, towards the target."""

    def settings(self, model: Plant) -> Settings:
        return self._watching(model)._replace(
            kind=FEEDBACK,
            proportional=self.proportional,
            derivative=self.derivative,
            feedforward=self.feedforward,
            slow=self.slow,
        )


@dataclass(frozen=True, slots=True)
class TimeOptimalLaw(Law):
    """Full control, switched where it just stops the mass at the target; kicks it out of rest."""

    name: Literal["time_optimal_law"] = "time_optimal_law"
    braking: Annotated[float, Gt(0), Le(10)] = 0.82
    """Share of the model's braking that is counted on."""
    boundary: Annotated[float, Gt(0), Le(1e6)] = 0.002
    """m: within so much of the switching curve the control falls in proportion."""
    derivative: Gain = 0.0
    """s: by so much times the velocity it switches earlier."""
    kicks: bool = False
    """Whether it leaves rest with full control."""

    def settings(self, model: Plant) -> Settings:
        return self._watching(model)._replace(
            kind=SWITCHING,
            braking=self.braking,
            boundary=self.boundary,
            derivative=self.derivative,
            kicks=self.kicks,
        )


@compiled
def feedback_control(
    error: float, velocity: float, plant: Plant, settings: Settings, memory: Memory
) -> float:
    """Return the control of PD, PID or PD with feedforward for an `error` (m) and `velocity`.

    The integral stands still while the control is at its limit and would be driven further beyond
    it (conditional integration; Astrom and Hagglund, PID Controllers, Sect. 3.5).
    """
    wanted: float = memory.registers[INTEGRAL] + settings.proportional * error
    wanted -= settings.derivative * velocity
    is_slow = abs(velocity) < settings.slow
    direction = math.copysign(1.0, error if is_slow else velocity)
    friction = friction_of(direction, plant)
    fed = friction.static if is_slow else friction.coulomb
    wanted += settings.feedforward * direction * fed
    push, pull = (
        acceleration(plant.highest_control, plant) - plant.bias,
        acceleration(plant.lowest_control, plant) - plant.bias,
    )
    is_driven_on = (wanted >= push and error > 0.0) or (wanted <= pull and error < 0.0)
    if not is_driven_on:
        total = memory.registers[INTEGRAL] + settings.integral * plant.time_step * error
        memory.registers[INTEGRAL] = min(push, max(pull, total))
    return (wanted - plant.bias) / plant.control_gain


@compiled
def switching_control(error: float, velocity: float, plant: Plant, settings: Settings) -> float:
    """Return the control of the time-optimal law for an `error` (m) and `velocity` (m/s)."""
    ahead = error - braking_distance(velocity, plant) / settings.braking
    ahead -= settings.derivative * velocity
    share = min(1.0, abs(ahead) / settings.boundary)
    if settings.kicks and abs(velocity) < plant.velocity_threshold:
        ahead, share = error, 1.0
    return share * (plant.highest_control if ahead > 0.0 else plant.lowest_control)
