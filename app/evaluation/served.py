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

    def model_for(self, request: AnyRequest) -> ModelDescription:
        """Return the model that a request needs.

        Raises:
            EvaluationError: there is none.
        """
        for model in self.models:
            if request.model:
                if request.model in (model.name, f"{model.name}/{model.version}"):
                    return model
            elif model.covers(request.system or self.nominal, request.horizon or DEFAULT_HORIZON):
                return model
        wanted = f"{request.model!r}" if request.model else f"that covers {request.system}"
        raise EvaluationError(f"the service has no model {wanted}")

    def cost(self, question: Question) -> Cost:
        """Return what all plans of an answer take, refinement apart.

        Raises:
            EvaluationError: there is no model for it.
        """
        recipe = question.request.recipe()
        samplers = None
        if needs_model(recipe.method):
            samplers = self.model_for(question.request).samplers
        each = recipe.settled(samplers).unrefined.cost()
        count = question.num_plans
        return Cost(count * each.network_evaluations, count * each.rollouts)
