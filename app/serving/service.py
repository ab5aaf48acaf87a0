"""From a request to an answer: resolve plant and model, check the limits, plan, report.

Plain blocking code: the routes plan in a thread, the command line calls it as it is.
"""

import secrets
from collections.abc import Container, Sequence
from dataclasses import asdict, dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np

from app.inference.model_store import ModelStore, UnfitModel
from app.planning.arrays import FloatArray
from app.planning.methods import WarmStarted
from app.planning.methods.base import MethodOptions
from app.planning.methods.settling import needs_model
from app.planning.plan import MultistepPlan, Plan
from app.planning.planner import plan, plan_multistep
from app.planning.plant.system import System
from app.planning.problem import (
    DEFAULT_HORIZON,
    Cost,
    Problem,
    Timing,
    as_state,
    state_after,
)
from app.planning.reachable.reachability import Reachability
from app.planning.recipe import Recipe
from app.planning.uncertainty.robustness import Robustness
from app.serving.admission import Work
from app.serving.ensembles import uncertainty_of
from app.serving.json_parts import json_parts
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.settings import Settings
from app.wire.answers import MultistepPlanResponse, PlanResponse, ReachabilityReport
from app.wire.requests import MAX_SEED, Inclusion, MultistepPlanRequest, PlanRequest, State

if TYPE_CHECKING:
    from app.inference.engine import Engine

AnyRequest: TypeAlias = PlanRequest | MultistepPlanRequest
R = TypeVar("R", PlanRequest, MultistepPlanRequest)

REACHABILITY_STEPS = 60_000
"""The reachable set takes about as long as so many simulated time steps."""

BYTES_PER_NUMBER = 21
"""Of an answer's text, about: 17 digits and what goes with them."""


class PlanningService:
    """All that answering takes.

    Args:
        settings: the limits.
        models: the model store.
        engine: runs the models; None where no plan needs one.
        rates: told how long plans took.
    """

    def __init__(
        self, settings: Settings, models: ModelStore, engine: "Engine | None", rates: Rates
    ) -> None:
        self._settings = settings
        self.models = models
        self._engine = engine
        self._rates = rates

    def resolve(self, request: R, arrived: float | None = None) -> "ResolvedRequest[R]":
        """Settle what a request leaves open, and refuse what it may not ask.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`; None for now.

        Raises:
            UnknownModel: it names a model that is not there.
            UnfitModel: the method needs a model, and none (or not the named one) covers the plant.
            InvalidField: it is larger than the settings allow, or a pending control exceeds the
                plant's limits.
        """
        num_targets = len(request.targets) if isinstance(request, MultistepPlanRequest) else 1
        named = self.models.find(request.model) if request.model else None
        system = request.system or (named.manifest.system if named else System())
        horizon = request.horizon or (named.manifest.horizon if named else DEFAULT_HORIZON)
        self._check_size(request, horizon, num_targets)
        check_controls("/pending_controls", request.pending_controls, system)
        seed = secrets.randbelow(MAX_SEED + 1) if request.seed is None else request.seed
        asked, model, samplers = request.recipe(), None, None
        if request.uncertainty:
            uncertainty = uncertainty_of(request.uncertainty, system, request.initial_state, seed)
            asked = replace(asked, uncertainty=uncertainty)
        if needs_model(asked.method):
            model = named or self.models.covering(system, horizon)
            if not model.covers(system, horizon):
                raise UnfitModel(f"{model.label} was trained for {model.coverage}")
            samplers = model.manifest.samplers
        recipe = asked.settled(samplers)
        cost = recipe.cost()
        self._check_cost(request, cost, horizon, num_targets)
        deadline_ms = request.deadline_ms or self._settings.max_deadline_ms
        repairs = recipe.refinement is not None and recipe.refinement.repair
        # Twice as long where a plan is traced back.
        num_sets = 2 if repairs else int(recipe.reachability)
        work = Work(
            recipe.num_candidates * cost.network_evaluations * num_targets,
            deadline=(arrived or perf_counter()) + deadline_ms / 1e3,
            model=model,
            rows_per_step=cost.predictions_per_step * recipe.num_candidates,
            rollout_steps=(cost.rollouts * horizon + num_sets * REACHABILITY_STEPS) * num_targets,
            kind=_kind(recipe),
            answer_bytes=BYTES_PER_NUMBER * _answer_numbers(request, horizon) * num_targets,
        )
        return ResolvedRequest(request, num_targets, recipe, system, horizon, seed, work)

    def answer(self, resolved: "ResolvedRequest[Any]", waited_ms: float = 0.0) -> dict[str, Any]:
        """Plan, and say what came of it.

        Args:
            resolved: what to plan.
            waited_ms: how long the request waited before this call, for the answer's timing.

        Returns:
            The fields of a `PlanResponse` or, for several targets, a `MultistepPlanResponse`, with
            None for what is absent, and numpy's arrays: of a million numbers, Python would make a
            million objects, and nobody else would get a word in. `json_parts` writes it.

        Raises:
            InvalidStepCount: more denoising steps than the model has diffusion times.
            PlanningError: the method failed.
            Stopped: the work's stop said so.
        """
        request, model, proposal = resolved.request, resolved.work.model, None
        if model:
            assert self._engine is not None
            proposal = self._engine.bind(model, resolved.work)
        recipe = resolved.recipe.able(proposal)
        if recipe.uncertainty:
            pending = np.array(request.pending_controls)
            recipe = replace(recipe, uncertainty=recipe.uncertainty.after(pending))
        rng = np.random.default_rng(resolved.seed)
        stop = resolved.work.stop
        if isinstance(request, MultistepPlanRequest):
            targets = [as_state(target) for target in request.targets]
            plans = plan_multistep(resolved.problem(request.targets[0]), targets, recipe, rng, stop)
            timing, fields = plans.timing, _multistep_fields(plans, request.include)
        else:
            single = plan(resolved.problem(request.target_state), recipe, rng, stop)
            timing, fields = single.timing, _segment_fields(single, request.include)
        self._measure(resolved, timing)
        fields["timing_ms"] = _timing_fields(Timing(queue=waited_ms) + timing)
        return resolved.provenance() | fields

    def plan(self, resolved: "ResolvedRequest[PlanRequest]") -> PlanResponse:
        """Answer `POST /plan` with what its client reads; errors as for `answer`."""
        return PlanResponse.model_validate_json(b"".join(json_parts(self.answer(resolved))))

    def plan_multistep(
        self, resolved: "ResolvedRequest[MultistepPlanRequest]"
    ) -> MultistepPlanResponse:
        """Answer `POST /plan_multistep` with what its client reads; errors as for `answer`."""
        text = b"".join(json_parts(self.answer(resolved)))
        return MultistepPlanResponse.model_validate_json(text)

    def _measure(self, resolved: "ResolvedRequest[Any]", timing: Timing) -> None:
        """Count how long the simulated time steps took, where that can be told.

        The time of an optimiser that starts from the network's candidates is the network's as well.
        """
        work = resolved.work
        if work.model and isinstance(resolved.recipe.method, WarmStarted):
            return
        computing_ms = timing.refine + timing.rollout + (0 if work.model else timing.propose)
        self._rates.add_steps(work.kind, computing_ms / 1e3, work.rollout_steps)

    def _check_size(self, request: AnyRequest, horizon: int, num_targets: int) -> None:
        """Refuse what is too large, whatever it costs."""
        settings = self._settings
        candidate_steps = request.num_candidates * horizon * num_targets
        numbers_each = 3 if "states" in request.include else 1
        answer_numbers = candidate_steps * numbers_each if "candidates" in request.include else 0
        check_limits(
            ("/num_candidates", "candidates", request.num_candidates, settings.max_candidates),
            ("/horizon", "time steps", horizon, settings.max_horizon),
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
        )

    def _check_cost(self, request: AnyRequest, cost: Cost, horizon: int, num_targets: int) -> None:
        """Refuse what costs too much."""
        settings = self._settings
        check_limits(
            (
                "/num_candidates",
                "rows through the network (candidates x network evaluations x targets)",
                request.num_candidates * cost.network_evaluations * num_targets,
                settings.max_network_rows,
            ),
            (
                "/num_candidates",
                "simulated time steps (rollouts x horizon x targets)",
                cost.rollouts * horizon * num_targets,
                settings.max_rollout_steps,
            ),
        )


@dataclass(frozen=True, slots=True)
class ResolvedRequest(Generic[R]):
    """A request with nothing left open."""

    request: R
    num_targets: int
    recipe: Recipe[MethodOptions]
    system: System
    horizon: int
    seed: int
    work: Work

    def problem(self, target: State) -> Problem:
        """Return the problem of getting from the initial state to `target`."""
        return Problem(self.start(), as_state(target), self.system, self.horizon)

    def start(self) -> FloatArray:
        """Return the state (2,) from which to plan: the one that the pending controls lead to.

        They are few time steps beside those of any plan, and are not counted as work.
        """
        initial_state = as_state(self.request.initial_state)
        return state_after(self.request.pending_controls, initial_state, self.system)

    @property
    def log_fields(self) -> dict[str, Any]:
        """What the service's log tells of it."""
        fields = {
            "method": self.recipe.method.name,
            "num_candidates": self.request.num_candidates,
            "num_targets": self.num_targets,
            "seed": self.seed,
        }
        return fields | ({"model": self.work.model.label} if self.work.model else {})

    def provenance(self) -> dict[str, Any]:
        """Return the fields of an answer that say where it comes from."""
        manifest = self.work.model and self.work.model.manifest
        reference = manifest and {
            "name": manifest.name,
            "version": str(manifest.version),
            "sha256": manifest.sha256,
        }
        return {
            "method": self.recipe.method.name,
            "model": reference,
            "seed": self.seed,
            "system": asdict(self.system),
            "predicted_initial_state": self.start() if self.request.pending_controls else None,
        }


def check_limits(*limits: tuple[str, str, int, int]) -> None:
    """Refuse the first value that exceeds its limit: pointer, what it counts, value, limit."""
    for pointer, what, value, limit in limits:
        if value > limit:
            raise InvalidField(pointer, f"{value} {what}; at most {limit} are allowed")


def check_controls(pointer: str, controls: Sequence[float], system: System) -> None:
    """Refuse controls that the plant cannot have been given."""
    lowest, highest = system.plant.lowest_control, system.plant.highest_control
    for index, control in enumerate(controls):
        if not lowest <= control <= highest:
            raise InvalidField(
                f"{pointer}/{index}",
                f"{control:g} is beyond the plant's limits, {lowest:g} to {highest:g}",
            )


def _kind(recipe: Recipe[MethodOptions]) -> str:
    """Return the kind of plans that take about as long for a simulated time step."""
    if recipe.refinement is None:
        return recipe.method.name
    if recipe.uncertainty:
        return f"{recipe.method.name}, refined for uncertain plants"
    return f"{recipe.method.name}, refined for {recipe.objective.name}"


def _answer_numbers(request: AnyRequest, horizon: int) -> int:
    """Return how many numbers of arrays an answer has for each target."""
    own = 2 if isinstance(request, MultistepPlanRequest) else 1  # in the segment, and in all
    sequences = own + (request.num_candidates if "candidates" in request.include else 0)
    return sequences * horizon * (3 if "states" in request.include else 1)


def _segment_fields(result: Plan, include: Container[Inclusion]) -> dict[str, Any]:
    """Return the fields of a `Segment`."""
    candidates = result.candidates
    with_states = "states" in include
    return {
        "controls": result.controls,
        "states": result.states if with_states else None,
        "terminal_error": result.terminal_error,
        "gap": result.gap,
        "reachability": result.reachability and _reachability_fields(result.reachability),
        "refinement": result.refinement and asdict(result.refinement),
        "robustness": result.robustness and _robustness_fields(result.robustness),
        "control_energy": result.control_energy,
        "control_smoothness": result.control_smoothness,
        "stuck_steps": result.stuck_steps,
        "diversity": candidates.diversity,
        "cost": _cost_fields(result.cost),
        "timing_ms": _timing_fields(result.timing),
        "candidates": {
            "controls": candidates.controls,
            "terminal_errors": candidates.terminal_errors,
            "states": candidates.states if with_states else None,
        }
        if "candidates" in include
        else None,
    }


def _reachability_fields(reachability: Reachability) -> dict[str, Any]:
    """Return the fields of a `ReachabilityReport`; the domain knows more."""
    return {name: getattr(reachability, name) for name in ReachabilityReport.model_fields}


def _robustness_fields(robustness: Robustness) -> dict[str, Any]:
    """Return the fields of a `RobustnessReport`, with the risk as it was asked for."""
    risk = robustness.risk
    asked_for = {"cvar": risk.level} if risk.name == "cvar" else risk.name
    return asdict(robustness) | {"risk": asked_for}


def _multistep_fields(result: MultistepPlan, include: Container[Inclusion]) -> dict[str, Any]:
    """Return the fields of a `MultistepPlanResponse` that say what was planned."""
    return {
        "segments": [_segment_fields(part, include) for part in result.segments],
        "controls": result.controls,
        "states": result.states if "states" in include else None,
        "final_error": result.final_error,
        "mean_end_error": result.mean_end_error,
        "mean_end_floor": result.mean_end_floor,
        "stuck_steps": result.stuck_steps,
        "cost": _cost_fields(result.cost),
    }


def _cost_fields(cost: Cost) -> dict[str, int]:
    """Return the fields of a `CostReport`."""
    return {"network_evaluations": cost.network_evaluations, "rollouts": cost.rollouts}


def _timing_fields(timing: Timing) -> dict[str, float]:
    """Return the fields of a `TimingReport`, to the microsecond: what lies below is noise."""
    fields = asdict(timing) | {"total": timing.total}
    return {stage: round(ms, 3) for stage, ms in fields.items()}
