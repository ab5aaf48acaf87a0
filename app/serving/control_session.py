"""A control session: what comes of its messages, one after the other. Nothing here waits or sends.

Who is let in, and where steps are computed, is in control_sessions.py.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any, Literal, TypeAlias

from app.planning.control import AnyController
from app.planning.control.carry import write_carry
from app.planning.control.memory import Memory
from app.planning.control.step import ControlStep, Goal, Measurement, control_step
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.serving.control import (
    check_measured,
    memory_of,
    planned_for,
    step_timing,
    steps_of,
)
from app.serving.rates import SECONDS_PER_STEP, Rate
from app.serving.refusals import OutOfOrder
from app.serving.seeds import drawn_seed
from app.serving.service import check_controls
from app.wire.sessions import AskedMessage, Measure, Start, Stop, Target

Fields: TypeAlias = dict[str, Any]
EndReason: TypeAlias = Literal["stopped", "idle", "draining"]

STEP_SECONDS, PRIOR_STEPS = 1e-4, 20
"""What a step takes beside what is simulated in it, until that was measured."""
MESSAGE_SECONDS = 3e-4
"""What a message takes besides: reading, checking and writing."""


@dataclass
class Loop:
    """What is controlled, and how far it is."""

    controller: AnyController
    system: System
    goal: Goal
    pending_controls: tuple[float, ...]
    ensemble: Ensemble | None
    memory: Memory | None
    deadline_ms: float
    include: frozenset[str]
    seconds: Rate
    """Of a step."""

    @property
    def load(self) -> float:
        """The share of the machine's time for which it is busy with this."""
        return (self.seconds.seconds_per_unit + MESSAGE_SECONDS) / self.system.time_step


Take: TypeAlias = Callable[[], ControlStep]
"""Does a step of a loop."""
Compute: TypeAlias = Callable[[Take, float], Awaitable[tuple[ControlStep, float]]]
"""Has a step done that takes about so many seconds; returns it, and the seconds that it took."""


class Session:
    """One machine's loop; every message gets one answer.

    Args:
        admit: lets a loop in, or raises `Refused`.
        compute: has steps computed.
    """

    def __init__(self, admit: Callable[[Loop], None], compute: Compute) -> None:
        self._admit = admit
        self._compute = compute
        self.loop: Loop | None = None
        self.steps = 0
        """Measurements that were answered."""
        self.late_steps = 0
        self.is_over = False

    async def answer(self, message: AskedMessage, arrived: float) -> Fields:
        """Return the answer to a message that arrived then, by `perf_counter`.

        Raises:
            OutOfOrder: it is not due.
            InvalidField: a field fits its schema, but not the others.
            Refused: there is too much to do already.
        """
        match message:
            case Start():
                return self._start(message)
            case Measure():
                return await self._measure(message, arrived)
            case Target():
                return self._target(message)
            case Stop():
                return self.end("stopped")

    def end(self, reason: EndReason) -> Fields:
        """Return the last message: where it ends, and what another session can go on with."""
        self.is_over = True
        ended: Fields = {
            "type": "ended",
            "reason": reason,
            "step": self.steps,
            "late_steps": self.late_steps,
        }
        if self.loop is None:
            return ended
        memory = self.loop.memory
        return ended | {
            "target_state": (self.loop.goal.target_position, 0.0),
            "steps_left": self.loop.goal.steps_left,
            "pending_controls": self.loop.pending_controls,
            "carry": write_carry(memory) if memory else None,
        }

    def _start(self, message: Start) -> Fields:
        if self.loop is not None:
            raise OutOfOrder("the session has started already")
        system = message.system or System()
        check_controls("/pending_controls", message.pending_controls, system)
        seed = None
        if message.uncertainty and message.uncertainty.relative:
            seed = drawn_seed(message.seed)
        ensemble = planned_for(message.uncertainty, message.controller, system, seed or 0)
        loop = Loop(
            message.controller,
            system,
            Goal(message.target_state[0], message.steps_left),
            tuple(message.pending_controls),
            ensemble,
            memory_of("/resume", message.resume),
            message.deadline_ms or 1e3 * system.time_step,
            frozenset(message.include),
            Rate(_expected_seconds(message, ensemble), PRIOR_STEPS),
        )
        self._admit(loop)
        self.loop = loop
        return {
            "type": "started",
            "controller": loop.controller.name,
            "system": loop.system,
            "seed": seed,
            "deadline_ms": loop.deadline_ms,
        }

    async def _measure(self, message: Measure, arrived: float) -> Fields:
        loop = self._begun()
        if message.step is not None and message.step != self.steps:
            raise OutOfOrder(f"measurement {self.steps} is due, and not {message.step}")
        measurement = Measurement(message.position, message.velocity)
        check_measured("/velocity", loop.controller, measurement)

        take = partial(
            control_step,
            loop.controller,
            loop.system,
            measurement,
            loop.goal,
            loop.memory,
            pending_controls=loop.pending_controls,
            ensemble=loop.ensemble,
        )
        taken, seconds = await self._compute(take, loop.seconds.seconds_per_unit)
        loop.seconds.add(seconds, 1)
        total_ms = 1e3 * (perf_counter() - arrived)
        is_late = total_ms > loop.deadline_ms
        self._go_on(loop, taken)
        self.late_steps += is_late
        include = loop.include
        step_ms = 1e3 * seconds
        return {
            "type": "control",
            "step": self.steps - 1,
            "control": taken.control,
            "status": taken.status,
            "late": is_late,
            "timing_ms": step_timing(max(0.0, total_ms - step_ms), step_ms),
            "estimate": taken.estimate if "estimate" in include else None,
            "plan": taken.plan if "plan" in include else None,
            "carry": write_carry(taken.memory) if "carry" in include else None,
        }

    def _go_on(self, loop: Loop, taken: ControlStep) -> None:
        self.steps += 1
        loop.memory = taken.memory
        if loop.pending_controls:
            loop.pending_controls = (*loop.pending_controls[1:], taken.control)
        left = loop.goal.steps_left
        if left is not None:
            loop.goal = Goal(loop.goal.target_position, max(0, left - 1))

    def _target(self, message: Target) -> Fields:
        self._begun().goal = Goal(message.target_state[0], message.steps_left)
        return {"type": "targeted", "step": self.steps}

    def _begun(self) -> Loop:
        if self.loop is None:
            raise OutOfOrder("the session has not started")
        return self.loop


def _expected_seconds(start: Start, ensemble: Ensemble | None) -> float:
    """Return about how long a step of a loop takes."""
    steps = steps_of(start.controller, start.steps_left, ensemble)
    return STEP_SECONDS + SECONDS_PER_STEP * steps
