"""From a request to an answer: resolve plant and model, check the limits, plan, report.

Plain blocking code: the routes run it in a thread, the command line calls it as it is.
"""

import secrets
from collections.abc import Container
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

import numpy as np

from app.api.errors import InvalidField
from app.api.schemas import (
    MAX_SEED,
    CandidatesReport,
    CostReport,
    Inclusion,
    ModelReference,
    MultistepPlanRequest,
    MultistepPlanResponse,
    PlanRequest,
    PlanResponse,
    ReachabilityReport,
    RefinementReport,
    Segment,
    TimingReport,
)
from app.inference.engine import Engine
from app.inference.model_store import Model, ModelStore, UnfitModel
from app.planning.methods import OPTIMISERS, Started
from app.planning.methods.base import LearnedProposal, Method
from app.planning.plan import Plan, RankedCandidates
from app.planning.planner import plan, plan_cost, plan_multistep
from app.planning.problem import DEFAULT_HORIZON, Cost, Problem, Timing, as_state
from app.planning.system import System
from app.settings import Settings

AnyRequest: TypeAlias = PlanRequest | MultistepPlanRequest


class PlanningService:
    """All that answering takes.

    Args:
        settings: the limits.
        models: the model store.
        engine: runs the models.
    """

    def __init__(self, settings: Settings, models: ModelStore, engine: Engine) -> None:
        self._settings = settings
        self.models = models
        self._engine = engine

    def plan(self, request: PlanRequest, waited_ms: float = 0.0) -> PlanResponse:
        """Answer `POST /plan`.

        Args:
            request: what to plan.
            waited_ms: how long the request waited before this call, for the answer's timing.

        Raises:
            UnknownModel: the request names a model that is not there.
            UnfitModel: the method needs a model, and none (or not the named one) fits the plant.
            InvalidField: the request is larger than the settings allow, or its fields clash.
            InvalidStepCount: more denoising steps than the model has diffusion times.
            PlanningError: the method failed.
        """
        task = self._resolve(request, num_targets=1)
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
            task.rng,
            task.learned,
            request.refine,
            request.objective,
        )
        segment = _segment(result, request.include, Timing(queue=waited_ms) + result.timing)
        return PlanResponse(**segment.__dict__, **task.provenance())

    def plan_multistep(
        self, request: MultistepPlanRequest, waited_ms: float = 0.0
    ) -> MultistepPlanResponse:
        """Answer `POST /plan_multistep`; arguments and errors as for `plan`."""
        task = self._resolve(request, num_targets=len(request.targets))
        result = plan_multistep(
            as_state(request.initial_state),
            [as_state(target) for target in request.targets],
            task.system,
            task.horizon,
            task.method,
            request.num_candidates,
            task.rng,
            task.learned,
            request.refine,
            request.objective,
        )
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

    def needs_network(self, request: AnyRequest) -> bool:
        """Say whether any part of the request samples from a model.

        Raises:
            InvalidField: its fields clash.
        """
        return _method(request).cost(request.num_candidates).network_evaluations > 0

    def _resolve(self, request: AnyRequest, num_targets: int) -> "_Task":
        """Settle what the request leaves open, and refuse what it may not ask."""
        named = self.models.find(request.model) if request.model else None
        system = request.system or (named.manifest.system if named else System())
        horizon = request.horizon or (named.manifest.horizon if named else DEFAULT_HORIZON)
        method = _method(request)
        self._check_limits(request, plan_cost(method, request.num_candidates), horizon, num_targets)
        seed = secrets.randbelow(MAX_SEED + 1) if request.seed is None else request.seed
        if not method.cost(request.num_candidates).network_evaluations:
            return _Task(method, system, horizon, seed)
        model = named or self.models.fitting(system, horizon)
        if not model.fits(system, horizon):
            raise UnfitModel(
                f"{model.label} was trained for another plant or horizon "
                f"({model.manifest.system}, horizon {model.manifest.horizon})"
            )
        return _Task(method, system, horizon, seed, model, self._engine.bind(model))

    def _check_limits(
        self, request: AnyRequest, cost: Cost, horizon: int, num_targets: int
    ) -> None:
        settings = self._settings
        k = request.num_candidates
        if request.refine:
            cost += request.refine.cost(k)
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
        ):
            if value > limit:
                raise InvalidField(pointer, f"{value} {what}; at most {limit} are allowed")


@dataclass(frozen=True, slots=True)
class _Task:
    """A request with nothing left open."""

    method: Method
    system: System
    horizon: int
    seed: int
    model: Model | None = None
    learned: LearnedProposal | None = None

    @property
    def rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)

    def provenance(self) -> dict[str, Any]:
        """Return the fields of an answer that say where it comes from."""
        manifest = self.model.manifest if self.model else None
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
