"""From a request to an answer: resolve plant and model, check the limits, plan, report.

Plain blocking code: the routes plan in a thread, the command line calls it as it is.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from time import perf_counter
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np

from app.inference.model_card import ModelCard
from app.inference.model_store import ModelStore, UnfitModel
from app.planning.arrays import FloatArray
from app.planning.methods import WarmStarted
from app.planning.methods.base import Method, MethodOptions
from app.planning.methods.settling import needs_model
from app.planning.plan import Plan
from app.planning.planner import plan_many, plan_multistep
from app.planning.plant.spread import Spread
from app.planning.plant.system import System
from app.planning.problem import (
    DEFAULT_HORIZON,
    Cost,
    Problem,
    Timing,
    as_state,
    state_after,
)
from app.planning.recipe import Recipe
from app.planning.uncertainty.robustness import NUM_SHOWN
from app.planning.uncertainty.told import tell
from app.planning.uncertainty.uncertainty import (
    FEW_MOTIONS,
    MAX_SYSTEMS,
    NUM_JUDGES,
)
from app.serving.admission import Work
from app.serving.answer_fields import multistep_fields, segment_fields, timing_fields
from app.serving.ensembles import uncertainty_of
from app.serving.json_parts import json_parts
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.serving.seeds import drawn_seed
from app.settings import Settings
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.requests import MultistepPlanRequest, PlanRequest, State

if TYPE_CHECKING:
    from app.inference.engine import Engine

AnyRequest: TypeAlias = PlanRequest | MultistepPlanRequest
R = TypeVar("R", PlanRequest, MultistepPlanRequest)

REACHABILITY_STEPS = 60_000
"""The reachable set takes about as long as so many simulated time steps."""

OUTLINE_NUMBERS = 1500
"""Of the outline of a reachable set, about."""
MAX_JUDGES = max(NUM_JUDGES, MAX_SYSTEMS)
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
        self,
        settings: Settings,
        models: ModelStore[ModelCard],
        engine: "Engine | None",
        rates: Rates,
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
        seed = drawn_seed(request.seed)
        asked, model, samplers = request.recipe(), None, None
        if request.uncertainty:
            uncertainty = uncertainty_of(request.uncertainty, system, request.initial_state, seed)
            asked = replace(asked, uncertainty=uncertainty)
        if needs_model(asked.method):
            # An optimiser that starts from candidates makes them plans for `system` again.
            warms = isinstance(asked.method, WarmStarted)
            may_be_off = (
                request.uncertainty is not None and request.uncertainty.robust and not warms
            )
            model = named or self.models.covering(system, horizon, may_be_off=may_be_off)
            if not model.covers(system, horizon):
                raise UnfitModel(f"{model.label} was trained for {model.coverage}")
            samplers = model.manifest.samplers
            if request.uncertainty and may_be_off and model.manifest.knows_uncertainty:
                motions = request.uncertainty.num_motions or FEW_MOTIONS
                asked = replace(asked, uncertainty=uncertainty.beside_a_model(motions))
        recipe = asked.settled(samplers)
        cost = recipe.cost()
        stages = _denoising_stages(request, cost)
        self._check_cost(request, cost, stages, horizon, num_targets)
        deadline_ms = request.deadline_ms or self._settings.max_deadline_ms
        repairs = recipe.refinement is not None and recipe.refinement.repair
        # Twice as long where a plan is traced back.
        num_sets = (2 if repairs else int(recipe.reachability)) + int(recipe.outline)
        rollouts = cost.rollouts + stages * recipe.num_candidates
        work = Work(
            recipe.num_candidates * cost.network_evaluations * num_targets,
            deadline=(arrived or perf_counter()) + deadline_ms / 1e3,
            model=model,
            rows_per_step=cost.predictions_per_step * recipe.num_candidates,
            rollout_steps=(rollouts * horizon + num_sets * REACHABILITY_STEPS) * num_targets,
            kind=_kind(recipe),
            answer_bytes=BYTES_PER_NUMBER * _answer_numbers(request, stages, horizon) * num_targets,
        )
        return ResolvedRequest(request, num_targets, recipe, system, horizon, seed, model, work)

    def answer(
        self,
        resolved: "ResolvedRequest[Any]",
        waited_ms: float = 0.0,
        told: Callable[[dict[str, Any]], None] | None = None,
    ) -> dict[str, Any]:
        """Plan, and say what came of it.

        Args:
            resolved: what to plan.
            waited_ms: how long the request waited before this call, for the answer's timing.
            told: called with the fields of each `Segment` of several, as soon as it is planned.

        Returns:
            The fields of a `PlanResponse` or, for several targets, a `MultistepPlanResponse`, as
            `json_parts` writes them.

        Raises:
            InvalidStepCount: more denoising steps than the model has diffusion times.
            PlanningError: the method failed.
            Stopped: the work's stop said so.
        """
        request = resolved.request
        if isinstance(request, MultistepPlanRequest):
            targets = [as_state(target) for target in request.targets]
            rng = np.random.default_rng(resolved.seed)
            problem, stop = resolved.problem(request.targets[0]), resolved.work.stop

            def tell(segment: Plan) -> None:
                if told:
                    told(segment_fields(segment, request.include))

            plans = plan_multistep(problem, targets, self._able(resolved), rng, stop, tell)
            timing, fields = plans.timing, multistep_fields(plans, request.include)
            fields["timing_ms"] = timing_fields(Timing(queue=waited_ms) + timing)
            answer = resolved.provenance() | fields
        else:
            [(answer, timing)] = self.answer_many([resolved], waited_ms)
        self._measure(resolved, timing)
        return answer

    def answer_many(
        self, resolved: "Sequence[ResolvedRequest[PlanRequest]]", waited_ms: float = 0.0
    ) -> "list[tuple[dict[str, Any], Timing]]":
        """Plan for requests that differ in start, target and seed alone; errors as for `answer`.

        Args:
            resolved: at least one, all of the same work.
            waited_ms: how long they waited together before this call.

        Returns:
            For each what `answer` returns, and what its plan took; where there are several, the
            mean of what they took together.
        """
        first = resolved[0]
        plans = plan_many(
            [each.problem(each.request.target_state) for each in resolved],
            self._able(first),
            [np.random.default_rng(each.seed) for each in resolved],
            first.work.stop,
        )
        waited = Timing(queue=waited_ms / len(plans))
        answers = []
        for each, plan in zip(resolved, plans, strict=True):
            fields = segment_fields(plan, each.request.include)
            fields["timing_ms"] = timing_fields(waited + plan.timing)
            answers.append((each.provenance() | fields, plan.timing))
        return answers

    def _able(self, resolved: "ResolvedRequest[Any]") -> Recipe[Method]:
        """Return the recipe of a request as one that can be followed."""
        proposal, model = None, resolved.model
        if model:
            assert self._engine is not None
            keeps_steps, told = "denoising" in resolved.request.include, None
            uncertainty = resolved.recipe.uncertainty
            if uncertainty and uncertainty.candidate_worth:
                most = Spread(**model.manifest.uncertainty)
                told = tell(uncertainty, resolved.system.plant, most)
            proposal = self._engine.bind(model, resolved.work, told, keeps_steps=keeps_steps)
        recipe = resolved.recipe.able(proposal)
        if recipe.uncertainty:
            pending = np.array(resolved.request.pending_controls)
            recipe = replace(recipe, uncertainty=recipe.uncertainty.after(pending))
        return recipe

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
        are_sent = "candidates" in request.include
        answer_numbers = candidate_steps * _numbers_a_step(request) if are_sent else 0
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

    def _check_cost(
        self, request: AnyRequest, cost: Cost, stages: int, horizon: int, num_targets: int
    ) -> None:
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
            (
                "/include",
                "numbers of candidates at all steps of their denoising",
                stages * request.num_candidates * horizon * _numbers_a_step(request) * num_targets,
                settings.max_answer_numbers,
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
    model: ModelCard | None
    """None where nothing goes through a network."""
    work: Work

    def problem(self, target: State) -> Problem:
        """Return the problem of getting from the initial state to `target`."""
        return Problem(self.start(), np.array(target), self.system, self.horizon)

    def start(self) -> FloatArray:
        """Return the state (2,) from which to plan: the one that the pending controls lead to.

        They are few time steps beside those of any plan, and are not counted as work.
        """
        initial_state = np.array(self.request.initial_state)
        if not self.request.pending_controls:
            return initial_state
        return state_after(self.request.pending_controls, initial_state, self.system)

    @property
    def settled(self) -> R:
        """The request with its seed: whoever answers it answers the same."""
        return self.request.model_copy(update={"seed": self.seed})

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
        manifest = self.model and self.model.manifest
        reference = manifest and {
            "name": manifest.name,
            "version": str(manifest.version),
            "sha256": manifest.sha256,
        }
        return {
            "method": self.recipe.method.name,
            "model": reference,
            "seed": self.seed,
            "system": _fields_of(self.system),
            "predicted_initial_state": self.start() if self.request.pending_controls else None,
        }


@lru_cache(maxsize=1024)
def _fields_of(system: System) -> dict[str, Any]:
    """Return the fields of a plant, for many answers the same ones; nobody changes them."""
    return asdict(system)


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
    if recipe.uncertainty and recipe.uncertainty.is_robust:
        return f"{recipe.method.name}, refined for uncertain plants"
    return f"{recipe.method.name}, refined for {recipe.objective.name}"


def _denoising_stages(request: AnyRequest, cost: Cost) -> int:
    """Return how many stages of each candidate's denoising an answer has, the noise included."""
    if "denoising" not in request.include or not cost.network_evaluations:
        return 0
    return 1 + cost.network_evaluations // cost.predictions_per_step


def _answer_numbers(request: AnyRequest, stages: int, horizon: int) -> int:
    """Return how many numbers of arrays an answer has for each target, about."""
    include = request.include
    own = 2 if isinstance(request, MultistepPlanRequest) else 1  # in the segment, and in all
    sequences = own + (request.num_candidates if "candidates" in include else 0)
    sequences += stages * request.num_candidates
    numbers = sequences * horizon * _numbers_a_step(request)
    if "candidate_errors" in include:
        numbers += request.num_candidates
    if "reachable_set" in include:
        numbers += OUTLINE_NUMBERS
    if "ensemble" in include and request.uncertainty:
        numbers += MAX_JUDGES + 2 * NUM_SHOWN * (horizon + 1)
    return numbers


def _numbers_a_step(request: AnyRequest) -> int:
    """Return how many numbers each time step of a sequence has: its control, and its state."""
    return 3 if "states" in request.include else 1
