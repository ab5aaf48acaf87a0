"""The models of a service as an evaluation knows them: which one answers, and what that costs."""

from collections.abc import Sequence
from dataclasses import dataclass

from app.evaluation.answer_log import EvaluationError
from app.evaluation.question import AnyPlanRequest, Question
from app.planning.methods.settling import needs_model
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON, Cost
from app.wire.about import ModelDescription
from app.wire.identification import IdentifyRequest
from app.wire.simulation import SimulateRequest

ROLLOUTS_OF_A_STEP = 5
"""What a step of a closed loop takes, about: a receding horizon's plan."""


@dataclass(frozen=True, slots=True)
class ServedModels:
    """What a service says of itself."""

    nominal: System
    """The plant of a request that names neither plant nor model."""
    models: Sequence[ModelDescription]
    """In the order in which the service looks for one that covers a plant."""

    def can_answer(self, question: Question) -> bool:
        """Say whether there is a model for it, if it needs one."""
        request = _learned(question)
        return request is None or self._model_for(request) is not None

    def answers_otherwise(self, question: Question, model: str | None) -> bool:
        """Say whether another model than `model`, a name/version, answers the question now.

        What there is no model for any more is answered by none.
        """
        request = _learned(question)
        if request is None:
            return False
        now = self._model_for(request)
        return now is not None and now.label != model

    def cost(self, question: Question) -> Cost:
        """Return what all plans of an answer take, refinement apart.

        Raises:
            EvaluationError: there is no model for it.
        """
        request, samplers = question.request, None
        if isinstance(request, IdentifyRequest):
            return Cost()
        if isinstance(request, SimulateRequest):
            steps = (request.steps or DEFAULT_HORIZON) * request.num_runs
            return Cost(rollouts=steps * ROLLOUTS_OF_A_STEP)
        recipe = request.recipe()
        if needs_model(recipe.method):
            model = self._model_for(request)
            if model is None:
                wanted = request.model or f"that was trained for {request.system or self.nominal}"
                raise EvaluationError(f"the service has no model {wanted}")
            samplers = model.samplers
        each, count = recipe.settled(samplers).unrefined.cost(), question.num_plans
        return Cost(count * each.network_evaluations, count * each.rollouts)

    def _model_for(self, request: AnyPlanRequest) -> ModelDescription | None:
        """Return the model that the service takes for a request."""
        if request.model:
            named = (each for each in self.models if request.model in (each.name, each.label))
            return next(named, None)
        system, horizon = request.system or self.nominal, request.horizon or DEFAULT_HORIZON
        covering = [model for model in self.models if model.covers(system, horizon)]
        is_robust = request.uncertainty is not None and request.uncertainty.robust
        may_be_off = is_robust and request.initial is None
        knowing = [model for model in covering if may_be_off and model.uncertainty]
        return next(iter((*knowing, *covering)), None)


def _learned(question: Question) -> AnyPlanRequest | None:
    """Return what is asked of a model, if that is."""
    request = question.request
    if isinstance(request, IdentifyRequest | SimulateRequest):
        return None
    return request if needs_model(request.recipe().method) else None
