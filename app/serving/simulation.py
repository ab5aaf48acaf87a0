"""Whole runs on a true machine: from a request to an answer."""

from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.control.runs import Runs
from app.planning.control.simulation import (
    Controls,
    Disturbance,
    Sensor,
    ToldOf,
    TrueMachine,
    simulate,
)
from app.planning.control.step import STATUSES
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.serving.admission import Work
from app.serving.control import planned_for, steps_of
from app.serving.ensembles import check_shared
from app.serving.json_parts import json_parts
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.serving.seeds import drawn_seed
from app.serving.service import BYTES_PER_NUMBER, check_controls, check_limits
from app.settings import Settings
from app.wire.requests import MAX_SEED
from app.wire.simulation import MAX_RUNS, SimulateRequest, SimulateResponse

DEFAULT_STEPS = 128
SERIES = {"states": 2, "measurements": 2, "estimates": 2}
"""Numbers of each step."""


@dataclass(frozen=True, slots=True)
class ResolvedSimulation:
    """Runs with nothing left open."""

    request: SimulateRequest
    machine: TrueMachine
    nominal_system: System
    ensemble: Ensemble | None
    """Plants that the controller plans for."""
    steps: int
    seed: int
    work: Work

    @property
    def settled(self) -> SimulateRequest:
        """The request with its seed: whoever answers it answers the same."""
        return self.request.model_copy(update={"seed": self.seed})

    @property
    def name(self) -> str:
        """Of the controller."""
        return self.request.controller.name if self.request.controller else "controls"

    @property
    def log_fields(self) -> dict[str, Any]:
        """What the service's log tells of it."""
        return {"method": self.name, "num_runs": self.request.num_runs, "seed": self.seed}


class SimulationService:
    """Runs of controllers and control sequences.

    Args:
        settings: the limits.
        rates: told how long they took.
    """

    def __init__(self, settings: Settings, rates: Rates) -> None:
        self._settings = settings
        self._rates = rates

    def resolve(self, request: SimulateRequest, arrived: float | None = None) -> ResolvedSimulation:
        """Settle what a request leaves open, and refuse what it may not ask.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`; None for now.

        Raises:
            InvalidField: the model, the machine and the ensemble do not go together, a control
                exceeds the limits, nothing estimates the velocity, or it is larger than the
                settings allow.
        """
        system = request.system or System()
        nominal = request.nominal_system or system
        controls, controller = request.controls, request.controller
        steps = request.steps or (DEFAULT_STEPS if controls is None else len(controls))
        check_shared("/nominal_system", nominal, system)
        check_controls("/controls", controls or [], system)
        sensor = request.sensor or Sensor()
        if controller and controller.observer is None and not sensor.measures_velocity:
            detail = "without velocities a controller needs an observer"
            raise InvalidField("/sensor/measures_velocity", detail)
        seed = drawn_seed(request.seed, MAX_SEED - MAX_RUNS)
        ensemble = planned_for(request.uncertainty, controller, nominal, seed)
        each = steps_of(controller, request.steps_left, ensemble) if controller else 1
        numbers = (1 + sum(SERIES[name] for name in request.include)) * steps * request.num_runs
        deadline_ms = request.deadline_ms or self._settings.max_deadline_ms
        check_limits(
            (
                "/num_runs",
                "numbers of runs (runs x steps x what each includes)",
                numbers,
                self._settings.max_answer_numbers,
            ),
            (
                "/num_runs",
                "simulated time steps (runs x steps x those of a controller's step)",
                request.num_runs * steps * each,
                self._settings.max_rollout_steps,
            ),
            ("/deadline_ms", "milliseconds", deadline_ms, self._settings.max_deadline_ms),
        )
        disturbance = request.disturbance.made if request.disturbance else Disturbance()
        work = Work(
            0,
            deadline=(arrived or perf_counter()) + deadline_ms / 1e3,
            model=None,
            rows_per_step=0,
            rollout_steps=request.num_runs * steps * each,
            kind=f"runs of {controller.name if controller else 'controls'}",
            answer_bytes=BYTES_PER_NUMBER * numbers,
        )
        return ResolvedSimulation(
            request,
            TrueMachine(system, disturbance, sensor, request.delay_steps),
            nominal,
            ensemble,
            steps,
            seed,
            work,
        )

    def answer(self, resolved: ResolvedSimulation, waited_ms: float = 0.0) -> dict[str, Any]:
        """Simulate, and say what came of it.

        Args:
            resolved: what to simulate.
            waited_ms: how long the request waited before this call, for the answer's timing.

        Returns:
            The fields of a `SimulateResponse`, with None for what is absent, and numpy's arrays.

        Raises:
            Stopped: the work's stop said so.
        """
        began = perf_counter()
        request, machine = resolved.request, resolved.machine
        controller = request.controller or Controls(np.array(request.controls, dtype=np.float64))
        target = request.target_state or request.initial_state
        told = ToldOf(resolved.nominal_system, target[0], request.steps_left, request.knows_delay)
        seeds = range(resolved.seed, resolved.seed + request.num_runs)
        runs = simulate(
            machine,
            request.initial_state,
            controller,
            told,
            resolved.steps,
            seeds,
            ensemble=resolved.ensemble,
            stop=resolved.work.stop,
        )
        seconds = perf_counter() - began
        self._rates.add_steps(resolved.work.kind, seconds, resolved.work.rollout_steps)
        timing = {"queue": waited_ms, "simulate": 1e3 * seconds, "total": waited_ms + 1e3 * seconds}
        return {
            "controller": resolved.name,
            "system": asdict(machine.system),
            "nominal_system": asdict(resolved.nominal_system),
            "seed": resolved.seed,
            "runs": _reports(runs, seeds, request),
            "timing_ms": {stage: round(ms, 3) for stage, ms in timing.items()},
        }

    def simulate(self, resolved: ResolvedSimulation) -> SimulateResponse:
        """Answer `POST /simulate` with what its client reads; errors as for `answer`."""
        return SimulateResponse.model_validate_json(b"".join(json_parts(self.answer(resolved))))


def _reports(runs: Runs, seeds: range, request: SimulateRequest) -> list[dict[str, Any]]:
    """Return the fields of a `RunReport` for each run."""
    has_target = request.target_state is not None
    series: dict[str, FloatArray] = {
        "states": runs.states,
        "measurements": runs.measurements,
        "estimates": runs.estimates,
    }
    errors, hunting, energies = runs.final_errors, runs.hunting, runs.energies
    never = runs.states.shape[1]
    return [
        {
            "seed": seed,
            "controls": runs.controls[i],
            **{name: series[name][i] for name in request.include},
            "final_state": runs.states[i, -1],
            "final_error": float(errors[i]) if has_target else None,
            "settling_step": int(settling) if has_target and settling < never else None,
            "hunting": bool(hunting[i]),
            "control_energy": float(energies[i]),
            "status": STATUSES[runs.statuses[i, -1]] if request.controller else None,
        }
        for i, (seed, settling) in enumerate(zip(seeds, runs.settling_steps, strict=True))
    ]
