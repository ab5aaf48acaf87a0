"""From a request to an answer: resolve plant and model, check the limits, plan, report.

Plain blocking code: the routes plan in a thread, the command line calls it as it is.
"""

import secrets
from collections.abc import Container
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from app.inference.engine import Engine
from app.inference.job import Job
from app.inference.model_store import ModelStore, UnfitModel
from app.planning.methods import OPTIMISERS, Started
from app.planning.methods.base import LearnedProposal, Method
from app.planning.plan import Plan, RankedCandidates
from app.planning.planner import plan, plan_cost, plan_multistep
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON, Cost, Problem, Timing, as_state
from app.serving.admission import Work
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.settings import Settings
from app.wire.answers import (
    CandidatesReport,
    CostReport,
    ModelReference,
    MultistepPlanResponse,
    PlanResponse,
    ReachabilityReport,
    RefinementReport,
    Segment,
    TimingReport,
)
from app.wire.requests import MAX_SEED, Inclusion, MultistepPlanRequest, PlanRequest

AnyRequest: TypeAlias = PlanRequest | MultistepPlanRequest
R = TypeVar("R", PlanRequest, MultistepPlanRequest)

FLOOR_STEPS = 60_000
"""Measuring a plan, its floor above all, takes about as long as so many simulated time steps."""


class PlanningService:
    """All that answering takes.

    Args:
        settings: the limits.
        models: the model store.
        engine: runs the models.
        rates: told how long plans took.
    """

    def __init__(
        self, settings: Settings, models: ModelStore, engine: Engine, rates: Rates
    ) -> None:
        self._settings = settings
        self.models = models
        self._engine = engine
        self._rates = rates

    def resolve(self, request: R, arrived: float | None = None) -> "Task[R]":
        """Settle what a request leaves open, and refuse what it may not ask.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`; None for now.

        Raises:
            UnknownModel: it names a model that is not there.
            UnfitModel: the method needs a model, and none (or not the named one) covers the plant.
            InvalidField: it is larger than the settings allow, or its fields clash.
        """
        num_targets = len(request.targets) if isinstance(request, MultistepPlanRequest) else 1
        named = self.models.find(request.model) if request.model else None
        system = request.system or (named.manifest.plants.nearest(System()) if named else System())
        horizon = request.horizon or (named.manifest.horizon if named else DEFAULT_HORIZON)
        method = _method(request)
        k = request.num_candidates
        cost = plan_cost(method, k)
        if request.refine:
            cost += request.refine.cost(k)
        self._check_limits(request, cost, horizon, num_targets)
        model = None
        if cost.network_evaluations:
            model = named or self.models.covering(system, horizon)
            if not model.covers(system, horizon):
                raise UnfitModel(f"{model.label} was trained for {model.coverage}")
        deadline_ms = request.deadline_ms or self._settings.max_deadline_ms
        rows = k * cost.network_evaluations * num_targets
        work = Work(
            job=Job(rows, (arrived or perf_counter()) + deadline_ms / 1e3),
            model=model,
            rows_per_step=2 * k,
            rollout_steps=(cost.rollouts * horizon + FLOOR_STEPS) * num_targets,
            kind=f"{method.name}, refined" if request.refine else method.name,
        )
        seed = secrets.randbelow(MAX_SEED + 1) if request.seed is None else request.seed
        return Task(request, num_targets, method, system, horizon, seed, work)

    def plan(self, task: "Task[PlanRequest]", waited_ms: float = 0.0) -> PlanResponse:
        """Answer `POST /plan`.

        Args:
            task: what to plan.
            waited_ms: how long the request waited before this call, for the answer's timing.

        Raises:
            InvalidStepCount: more denoising steps than the model has diffusion times.
            PlanningError: the method failed.
            Stopped: the task's stop said so.
        """
        request = task.request
        problem = Problem(
            as_state(request.initial_state),
            as_state(request.target_state),
            task.system,
            task.horizon,
        )
        result = plan(
            problem,
            task.method,
            request.num_candidates,
            np.random.default_rng(task.seed),
            self._learned(task),
            request.refine,
            request.objective,
            task.work.job.stop,
        )
        self._measure(task, result.timing)
        segment = _segment(result, request.include, Timing(queue=waited_ms) + result.timing)
        return PlanResponse(**segment.__dict__, **task.provenance())

    def plan_multistep(
        self, task: "Task[MultistepPlanRequest]", waited_ms: float = 0.0
    ) -> MultistepPlanResponse:
        """Answer `POST /plan_multistep`; arguments and errors as for `plan`."""
        request = task.request
        result = plan_multistep(
            as_state(request.initial_state),
            [as_state(target) for target in request.targets],
            task.system,
            task.horizon,
            task.method,
            request.num_candidates,
            np.random.default_rng(task.seed),
            self._learned(task),
            request.refine,
            request.objective,
            task.work.job.stop,
        )
        self._measure(task, result.timing)
        include = request.include
        return MultistepPlanResponse(
            segments=[_segment(part, include, part.timing) for part in result.segments],
            controls=result.controls.tolist(),
            states=result.states.tolist() if "states" in include else None,
            final_error=result.final_error,
            mean_end_error=result.mean_end_error,
            mean_end_floor=result.mean_end_floor,
            stuck_steps=result.stuck_steps,
            cost=_cost(result.cost),
            timing_ms=_timing(Timing(queue=waited_ms) + result.timing),
            **task.provenance(),
        )

    def _learned(self, task: "Task[Any]") -> LearnedProposal | None:
        work = task.work
        return self._engine.bind(work.model, work.job) if work.model else None

    def _measure(self, task: "Task[Any]", timing: Timing) -> None:
        """Count how long the simulated time steps took, where that can be told.

        The time of an optimiser that starts from the network's candidates is the network's as well.
        """
        work = task.work
        if work.model and isinstance(task.method, Started):
            return
        computing_ms = timing.refine + timing.rollout + (0 if work.model else timing.propose)
        self._rates.add_steps(work.kind, computing_ms / 1e3, work.rollout_steps)

    def _check_limits(
        self, request: AnyRequest, cost: Cost, horizon: int, num_targets: int
    ) -> None:
        settings = self._settings
        k = request.num_candidates
        candidate_steps = k * horizon * num_targets
        numbers_each = 3 if "states" in request.include else 1
        answer_numbers = candidate_steps * numbers_each if "candidates" in request.include else 0
        for pointer, what, value, limit in (
            ("/num_candidates", "candidates", k, settings.max_candidates),
            ("/horizon", "time steps", horizon, settings.max_horizon),
            (
                "/num_candidates",
                "rows through the network (candidates x network evaluations x targets)",
                k * cost.network_evaluations * num_targets,
                settings.max_network_rows,
            ),
            (
                "/num_candidates",
                "simulated time steps (rollouts x horizon x targets)",
                cost.rollouts * horizon * num_targets,
                settings.max_rollout_steps,
            ),
            (
                "/num_candidates",
                "time steps of candidates (candidates x horizon x targets)",
                candidate_steps,
                settings.max_candidate_steps,
            ),
            ("/include", "numbers of candidates", answer_numbers, settings.max_answer_numbers),
            (
                "/deadline_ms",
                "milliseconds",
                request.deadline_ms or 0,
                settings.max_deadline_ms,
            ),
        ):
            if value > limit:
                raise InvalidField(pointer, f"{value} {what}; at most {limit} are allowed")


@dataclass(frozen=True, slots=True)
class Task(Generic[R]):
    """A request with nothing left open."""

    request: R
    num_targets: int
    method: Method
    system: System
    horizon: int
    seed: int
    work: Work

    def provenance(self) -> dict[str, Any]:
        """Return the fields of an answer that say where it comes from."""
        manifest = self.work.model and self.work.model.manifest
        reference = manifest and ModelReference(
            name=manifest.name, version=str(manifest.version), sha256=manifest.sha256
        )
        return {
            "method": self.method.name,
            "model": reference,
            "seed": self.seed,
            "system": self.system,
        }


def _method(request: AnyRequest) -> Method:
    """Return the method that was asked for, started from another one if that was asked too."""
    if request.initial is None:
        return request.method
    if not isinstance(request.method, OPTIMISERS):
        startable = ", ".join(optimiser().name for optimiser in OPTIMISERS)
        raise InvalidField(
            "/initial", f"{request.method.name} starts from nothing; {startable} can be started"
        )
    return Started(request.method, request.initial.method)


def _segment(result: Plan, include: Container[Inclusion], timing: Timing) -> Segment:
    with_states = "states" in include
    return Segment(
        controls=result.controls.tolist(),
        states=result.states.tolist() if with_states else None,
        terminal_error=result.terminal_error,
        gap=result.gap,
        reachability=ReachabilityReport.model_validate(result.reachability, from_attributes=True),
        refinement=result.refinement and RefinementReport(**asdict(result.refinement)),
        control_energy=result.control_energy,
        control_smoothness=result.control_smoothness,
        stuck_steps=result.stuck_steps,
        cost=_cost(result.cost),
        timing_ms=_timing(timing),
        candidates=(
            _candidates(result.candidates, with_states) if "candidates" in include else None
        ),
    )


def _candidates(candidates: RankedCandidates, with_states: bool) -> CandidatesReport:
    return CandidatesReport(
        controls=candidates.controls.tolist(),
        terminal_errors=candidates.terminal_errors.tolist(),
        states=candidates.states.tolist() if with_states else None,
    )


def _cost(cost: Cost) -> CostReport:
    return CostReport(**asdict(cost))


def _timing(timing: Timing) -> TimingReport:
    return TimingReport(**asdict(timing), total=timing.total)
