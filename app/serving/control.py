"""One step of a closed loop, without a session: from a request to an answer."""

from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from app.planning.control import AnyController, RecedingHorizon
from app.planning.control.carry import InvalidCarry, read_carry, write_carry
from app.planning.control.memory import MAX_PLAN, Memory
from app.planning.control.step import ControlStep, Fallback, Goal, Measurement, control_step
from app.planning.methods.settling import needs_model
from app.planning.objectives import TERMINAL_ERROR
from app.planning.plant.system import System
from app.planning.recipe import Recipe
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.uncertainty import ROLLOUTS_PER_ITERATION
from app.serving.admission import Work
from app.serving.ensembles import ensemble_of
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.serving.seeds import drawn_seed
from app.serving.service import check_controls, check_limits
from app.settings import Settings
from app.wire import control as wire
from app.wire.uncertainty import Ensemble as Ensembled

STEP_STEPS = 1000
"""A step takes about as long as so many simulated time steps, whatever its controller computes."""
ANSWER_BYTES = 30_000
"""Of a step's answer at most, about: the carry is most of it."""


@dataclass(frozen=True, slots=True)
class ResolvedStep:
    """A step with nothing left open."""

    request: wire.ControlRequest
    controller: AnyController
    system: System
    measurement: Measurement
    goal: Goal
    memory: Memory | None
    pending_controls: tuple[float, ...]
    ensemble: Ensemble | None
    """Plants that are planned for."""
    recipe: Recipe[Any] | None
    """Of a fallback."""
    seed: int | None
    work: Work

    @property
    def settled(self) -> wire.ControlRequest:
        """The request with its seed: whoever answers it answers the same."""
        return self.request.model_copy(update={"seed": self.seed})

    @property
    def log_fields(self) -> dict[str, Any]:
        """What the service's log tells of it."""
        fields = {"method": self.controller.name}
        return fields if self.seed is None else fields | {"seed": self.seed}


class ControlService:
    """Single steps.

    Args:
        settings: the limits.
        rates: told how long they took.
    """

    def __init__(self, settings: Settings, rates: Rates) -> None:
        self._settings = settings
        self._rates = rates

    def resolve(self, request: wire.ControlRequest, arrived: float | None = None) -> ResolvedStep:
        """Settle what a request leaves open, and refuse what it may not ask.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`; None for now.

        Raises:
            InvalidField: the carry is not what a step gave, a pending control exceeds the plant's
                limits, a velocity is missing, the fallback is none or too large, or nothing
                plans for the ensemble.
        """
        system = request.system or System()
        controller = request.controller
        position, velocity = request.state or (request.position or 0.0, None)
        measurement = Measurement(position, velocity)
        check_measured("/position", controller, measurement)
        check_controls("/pending_controls", request.pending_controls, system)
        seed = None
        if request.fallback or (request.uncertainty and request.uncertainty.relative):
            seed = drawn_seed(request.seed)
        ensemble = planned_for(request.uncertainty, controller, system, seed or 0)
        recipe, rollout_steps = None, steps_of(controller, request.steps_left, ensemble)
        if request.fallback and ensemble:
            detail = "plans for one plant: with an uncertainty there is none"
            raise InvalidField("/fallback", detail)
        if request.fallback:
            recipe = self._recipe(request.fallback)
            rollout_steps += recipe.cost().rollouts * MAX_PLAN
        check_limits(
            (
                "/fallback/num_candidates",
                "simulated time steps of a fallback (rollouts x horizon)",
                rollout_steps,
                self._settings.max_rollout_steps,
            ),
            (
                "/deadline_ms",
                "milliseconds",
                request.deadline_ms or 0,
                self._settings.max_deadline_ms,
            ),
        )
        deadline_ms = request.deadline_ms or self._settings.max_deadline_ms
        work = Work(
            0,
            deadline=(arrived or perf_counter()) + deadline_ms / 1e3,
            model=None,
            rows_per_step=0,
            rollout_steps=rollout_steps,
            kind=f"a step of {controller.name}" + (" with a fallback" if recipe else ""),
            answer_bytes=ANSWER_BYTES,
        )
        return ResolvedStep(
            request,
            controller,
            system,
            measurement,
            Goal(request.target_state[0], request.steps_left),
            memory_of("/carry", request.carry),
            tuple(request.pending_controls),
            ensemble,
            recipe,
            seed,
            work,
        )

    def _recipe(self, asked: wire.Fallback) -> Recipe[Any]:
        if needs_model(asked.method):
            detail = "models plan for one horizon only, and a fallback is asked for any"
            raise InvalidField("/fallback/method", detail)
        check_limits(
            (
                "/fallback/num_candidates",
                "candidates",
                asked.num_candidates,
                self._settings.max_candidates,
            )
        )
        asked_for = Recipe(
            asked.method, asked.num_candidates, asked.refine, TERMINAL_ERROR, reachability=False
        )
        return asked_for.settled(None).able(None)

    def answer(self, resolved: ResolvedStep, waited_ms: float = 0.0) -> dict[str, Any]:
        """Do the step, and say what came of it.

        Args:
            resolved: the step.
            waited_ms: how long the request waited before this call, for the answer's timing.

        Returns:
            The fields of a `ControlResponse`, with None for what is absent.

        Raises:
            PlanningError: the fallback's method failed.
            Stopped: the work's stop said so.
        """
        began = perf_counter()
        fallback = None
        if resolved.recipe:
            fallback = Fallback(resolved.recipe, np.random.default_rng(resolved.seed))
        taken = control_step(
            resolved.controller,
            resolved.system,
            resolved.measurement,
            resolved.goal,
            resolved.memory,
            pending_controls=resolved.pending_controls,
            ensemble=resolved.ensemble,
            fallback=fallback,
            stop=resolved.work.stop,
        )
        seconds = perf_counter() - began
        self._rates.add_steps(resolved.work.kind, seconds, resolved.work.rollout_steps)
        return {
            "controller": resolved.controller.name,
            "system": asdict(resolved.system),
            "seed": resolved.seed,
            **step_fields(taken),
            "timing_ms": step_timing(waited_ms, 1e3 * seconds),
        }


def step_fields(taken: ControlStep) -> dict[str, Any]:
    """Return the fields of a step's answer that say what came of it."""
    return {
        "control": taken.control,
        "plan": taken.plan,
        "predicted_states": taken.predicted_states,
        "predicted_error": taken.predicted_error,
        "status": taken.status,
        "estimate": taken.estimate,
        "carry": write_carry(taken.memory),
    }


def step_timing(queue_ms: float, step_ms: float) -> dict[str, float]:
    """Return the fields of a `StepTiming`, to the microsecond."""
    stages = {"queue": queue_ms, "step": step_ms, "total": queue_ms + step_ms}
    return {stage: round(ms, 3) for stage, ms in stages.items()}


def steps_of(
    controller: AnyController, steps_left: int | None, ensemble: Ensemble | None = None
) -> int:
    """Return about how many simulated time steps one step of a controller takes, at most."""
    if not isinstance(controller, RecedingHorizon):
        return STEP_STEPS
    horizon = max(controller.least_horizon, min(steps_left or MAX_PLAN, MAX_PLAN))
    plans = 1.0 + ROLLOUTS_PER_ITERATION * (len(ensemble) if ensemble else 0)
    return STEP_STEPS + int(plans * controller.iterations * horizon)


def planned_for(
    asked: Ensembled | None, controller: AnyController | None, system: System, seed: int
) -> Ensemble | None:
    """Return the plants that a controller is to plan for.

    Raises:
        InvalidField: it makes no plans, or the plants are not like `system`.
    """
    if asked is None:
        return None
    if not isinstance(controller, RecedingHorizon):
        detail = "only receding_horizon makes plans, and so for plants that may be the true one"
        raise InvalidField("/uncertainty", detail)
    # Wherever the mass is, it is there on all of them.
    return ensemble_of(asked, system, np.zeros(2), seed)


def check_measured(pointer: str, controller: AnyController, measurement: Measurement) -> None:
    """Refuse a measurement without a velocity for a controller that does not estimate it."""
    if measurement.velocity is None and controller.observer is None:
        detail = "the velocity is not measured, and the controller has no observer to estimate it"
        raise InvalidField(pointer, detail)


def memory_of(pointer: str, carry: dict[str, Any] | None) -> Memory | None:
    """Return what was carried.

    Raises:
        InvalidField: it is not what a step gave.
    """
    if carry is None:
        return None
    try:
        return read_carry(carry)
    except InvalidCarry as error:
        field = f"/{error.field}" if error.field else ""
        raise InvalidField(f"{pointer}{field}", str(error)) from None
