"""The models of a service as an evaluation knows them: which one answers, and what that costs."""

from collections.abc import Sequence
from dataclasses import dataclass

from app.evaluation.answer_log import EvaluationError
from app.evaluation.question import AnyRequest, Question
from app.planning.methods.settling import needs_model
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON, Cost
from app.wire.about import ModelDescription


@dataclass(frozen=True, slots=True)
class ServedModels:
    """What a service says of itself."""

    nominal: System
    """The plant of a request that names neither plant nor model."""
    models: Sequence[ModelDescription]
    """In the order in which the service looks for one that covers a plant."""

    def can_answer(self, question: Question) -> bool:
        """Say whether there is a model for it, if it needs one."""
        return not _needs_model(question) or self._model_for(question.request) is not None

    def answers_otherwise(self, question: Question, model: str | None) -> bool:
        """Say whether another model than `model`, a name/version, answers the question now.

        What there is no model for any more is answered by none.
        """
        if not _needs_model(question):
            return False
        now = self._model_for(question.request)
        return now is not None and now.label != model

    def cost(self, question: Question) -> Cost:
        """Return what all plans of an answer take, refinement apart.

        Raises:
            EvaluationError: there is no model for it.
        """
        if not question.is_plan:
            return Cost()
        request, samplers = question.request, None
        recipe = request.recipe()
        if needs_model(recipe.method):
            model = self._model_for(request)
            if model is None:
                wanted = request.model or f"that was trained for {request.system or self.nominal}"
                raise EvaluationError(f"the service has no model {wanted}")
            samplers = model.samplers
        each, count = recipe.settled(samplers).unrefined.cost(), question.num_plans
        return Cost(count * each.network_evaluations, count * each.rollouts)

    def _model_for(self, request: AnyRequest) -> ModelDescription | None:
        """Return the model that the service takes for a request."""
        for model in self.models:
            if request.model:
                if request.model in (model.name, model.label):
                    return model
            elif model.covers(request.system or self.nominal, request.horizon or DEFAULT_HORIZON):
                return model
        return None


def _needs_model(question: Question) -> bool:
    return question.is_plan and needs_model(question.request.recipe().method)
