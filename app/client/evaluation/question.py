"""What a suite asks: a request, who takes part in it, and what the report calls them."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

from app.api.schemas import MultistepPlanRequest, PlanRequest
from app.planning.problem import Cost

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
    def is_multistep(self) -> bool:
        """Whether it goes to `/plan_multistep`."""
        return isinstance(self.request, MultistepPlanRequest)

    @property
    def num_plans(self) -> int:
        """How many plans the answer holds."""
        return len(self.request.targets) if isinstance(self.request, MultistepPlanRequest) else 1

    @property
    def cost(self) -> Cost:
        """What all its plans take, refinement apart."""
        k, initial = self.request.num_candidates, self.request.initial
        each = self.request.method.cost(k) + Cost(rollouts=k)
        if initial:
            each += initial.method.cost(k)
        return Cost(self.num_plans * each.network_evaluations, self.num_plans * each.rollouts)

    @cached_property
    def body(self) -> dict[str, Any]:
        """What is asked, without labels: the same body is the same question."""
        return {
            "path": "/plan_multistep" if self.is_multistep else "/plan",
            "trajectories": self.trajectories,
            "request": self.request.model_dump(mode="json", exclude_none=True),
        }

    @cached_property
    def key(self) -> str:
        """Identify the question in a log of answers."""
        return key_of(self.body)


def key_of(body: Mapping[str, Any]) -> str:
    """Return the hash of a question's body, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
