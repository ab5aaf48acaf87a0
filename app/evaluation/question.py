"""What a suite asks: a request, who takes part in it, and what the report calls them."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

from app.evaluation.tasks import request_seed
from app.planning.planner import plan_cost
from app.planning.problem import Cost
from app.wire.requests import MultistepPlanRequest, PlanRequest

AnyRequest: TypeAlias = PlanRequest | MultistepPlanRequest


@dataclass(frozen=True, slots=True)
class Entrant:
    """A way of planning that is compared with others."""

    label: str
    """As tables and figures call it."""
    fields: Mapping[str, Any] = field(compare=False)
    """Of the request: method, refinement, objective."""


@dataclass(frozen=True)
class Question:
    """One request, and where its answer belongs in the suite's table."""

    labels: Mapping[str, str | int | float]
    """Columns of the suite's data: entrant, num_candidates, task, run and what else it varies."""
    request: AnyRequest
    trajectories: bool = False
    """Whether controls, states and candidates of the answer are wanted, or its measures alone."""

    @property
    def num_plans(self) -> int:
        """How many plans the answer holds."""
        return len(self.request.targets) if isinstance(self.request, MultistepPlanRequest) else 1

    @property
    def cost(self) -> Cost:
        """What all its plans take, refinement apart."""
        k, initial = self.request.num_candidates, self.request.initial
        each = plan_cost(self.request.method, k)
        if initial:
            each += initial.method.cost(k)
        return Cost(self.num_plans * each.network_evaluations, self.num_plans * each.rollouts)

    @property
    def body(self) -> dict[str, Any]:
        """What is asked, without labels: the same body is the same question.

        Fields of the request, and parameters of its plant, are left out where they have their
        default value: a question stays the same when there come to be more of them. A method has
        all its options: with other defaults it is another question.
        """
        multistep = isinstance(self.request, MultistepPlanRequest)
        said = self.request.model_dump(mode="json", exclude_defaults=True)
        whole = self.request.model_dump(
            mode="json", include=said.keys() - {"system"}, exclude_none=True
        )
        return {
            "path": "/plan_multistep" if multistep else "/plan",
            "trajectories": self.trajectories,
            "request": said | whole,
        }

    @cached_property
    def key(self) -> str:
        """Identify the question in a log of answers."""
        return key_of(self.body)


def question_to(
    entrant: Entrant,
    kind: type[AnyRequest],
    fields: Mapping[str, Any],
    num_candidates: int,
    seed: int,
    task: int,
    run: int,
    *,
    labels: Mapping[str, float] | None = None,
    trajectories: bool = False,
) -> Question:
    """Return what `entrant` is asked for one run of a task.

    Args:
        entrant: who plans.
        kind: of the request.
        fields: of the request: start, targets, and what else is not the entrant's.
        num_candidates: K.
        seed: of the suite; with task and run it decides the request's.
        task: from 0.
        run: from 0.
        labels: more columns of the suite's data.
        trajectories: whether controls, states and candidates of the answer are wanted, too.

    Raises:
        ValidationError: the service would refuse such a request.
    """
    request = kind.model_validate(
        {
            **entrant.fields,
            "num_candidates": num_candidates,
            "seed": request_seed(seed, task, run),
            "include": [],
            **fields,
        }
    )
    return Question(
        {
            **(labels or {}),
            "entrant": entrant.label,
            "num_candidates": num_candidates,
            "task": task,
            "run": run,
        },
        request,
        trajectories,
    )


def key_of(body: Mapping[str, Any]) -> str:
    """Return the hash of a question's body, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
