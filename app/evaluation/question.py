"""What a suite asks: a request, who takes part in it, and what the report calls them.

Most suites ask for plans; a log that a machine is to be identified from is asked the same way.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

from app.figures.style import Look
from app.wire.identification import IdentifyRequest
from app.wire.requests import MultistepPlanRequest, PlanRequest

AnyRequest: TypeAlias = PlanRequest | MultistepPlanRequest
SERIES = ("controls", "positions", "velocities")
"""Of a log; thousands of numbers, of which an evaluation keeps a digest."""


@dataclass(frozen=True, slots=True)
class Entrant:
    """A way of planning that is compared with others."""

    label: str
    """As tables and figures call it."""
    fields: dict[str, Any] = field(compare=False)
    """Of the request: method, refinement, objective, plant."""
    look: Look
    """In figures."""

    def asking(self, **fields: Any) -> "Entrant":
        """Return the entrant with more fields of the request."""
        return replace(self, fields=self.fields | fields)

    def request(self, task: Mapping[str, Any], num_candidates: int, seed: int) -> AnyRequest:
        """Return the request for a task, by default with the shortest answer.

        Raises:
            ValidationError: the service would refuse such a request.
        """
        kind = MultistepPlanRequest if "targets" in task else PlanRequest
        shared = {"num_candidates": num_candidates, "seed": seed, "include": []}
        return kind.model_validate({**self.fields, **shared, **task})


@dataclass(frozen=True)
class Question:
    """One request, and where its answer belongs in the suite's table."""

    labels: Mapping[str, str | int | float]
    """Columns of the suite's data: entrant, num_candidates, task, run and what else it varies."""
    asked: AnyRequest | IdentifyRequest
    trajectories: bool = False
    """Whether controls, states and candidates of the answer are wanted, or its measures alone."""
    if_covered: bool = False
    """Whether it is left out where no model of the service covers its plant."""

    @property
    def is_plan(self) -> bool:
        """Whether a plan is asked for."""
        return not isinstance(self.asked, IdentifyRequest)

    @property
    def request(self) -> AnyRequest:
        """The request for a plan, or for several."""
        assert not isinstance(self.asked, IdentifyRequest)
        return self.asked

    @property
    def log(self) -> IdentifyRequest:
        """The request to identify a machine from its log."""
        assert isinstance(self.asked, IdentifyRequest)
        return self.asked

    @property
    def num_plans(self) -> int:
        """How many plans the answer holds."""
        return len(self.asked.targets) if isinstance(self.asked, MultistepPlanRequest) else 1

    @property
    def path(self) -> str:
        """Where it is asked."""
        if isinstance(self.asked, IdentifyRequest):
            return "/identify"
        return "/plan_multistep" if isinstance(self.asked, MultistepPlanRequest) else "/plan"

    @property
    def body(self) -> dict[str, Any]:
        """What is asked, without labels: the same body is the same question.

        Fields of the request, and parameters of its plant, are left out where they have their
        default value: a question stays the same when there come to be more of them. A method has
        all its options: with other defaults it is another question.
        """
        said = self.asked.model_dump(mode="json", exclude_defaults=True)
        whole = self.asked.model_dump(
            mode="json", include=said.keys() - {"system"}, exclude_none=True
        )
        request = said | whole
        if isinstance(self.asked, IdentifyRequest):
            request |= {name: _digest(request[name]) for name in SERIES if name in request}
        return {"path": self.path, "trajectories": self.trajectories, "request": request}

    @cached_property
    def key(self) -> str:
        """Identify the question in a log of answers."""
        return key_of(self.body)


def _digest(values: Any) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()


def key_of(body: Mapping[str, Any]) -> str:
    """Return the hash of a question's body, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
