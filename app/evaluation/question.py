"""What a suite asks: a request, who takes part in it, and what the report calls them.

Most suites ask for plans; logs to identify a machine from, and runs, are asked the same way.
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
from app.wire.simulation import SimulateRequest

AnyPlanRequest: TypeAlias = PlanRequest | MultistepPlanRequest
AnyRequest: TypeAlias = AnyPlanRequest | IdentifyRequest | SimulateRequest
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

    def request(self, task: Mapping[str, Any], num_candidates: int, seed: int) -> AnyPlanRequest:
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
    request: AnyRequest
    trajectories: bool = False
    """Whether controls, states and candidates of the answer are wanted, or its measures alone."""
    if_covered: bool = False
    """Whether it is left out where no model of the service covers its plant."""
    kept_steps: tuple[int, ...] = ()
    """Of runs: the steps whose states are kept."""

    @property
    def plan(self) -> AnyPlanRequest:
        """The request, where it is for a plan or for several."""
        assert isinstance(self.request, PlanRequest | MultistepPlanRequest)
        return self.request

    @property
    def num_plans(self) -> int:
        """How many plans the answer holds."""
        return len(self.request.targets) if isinstance(self.request, MultistepPlanRequest) else 1

    @property
    def body(self) -> dict[str, Any]:
        """What is asked, without labels: the same body is the same question.

        Fields of the request, and parameters of its plant, are left out where they have their
        default value: a question stays the same when there come to be more of them. A method has
        all its options: with other defaults it is another question.
        """
        said = self.request.model_dump(mode="json", exclude_defaults=True)
        whole = self.request.model_dump(
            mode="json", include=said.keys() - {"system", "nominal_system"}, exclude_none=True
        )
        request = said | whole
        if isinstance(self.request, IdentifyRequest):
            request |= {name: _digest(request[name]) for name in SERIES if name in request}
        path = _path_of(self.request)
        body = {"path": path, "trajectories": self.trajectories, "request": request}
        return body | ({"kept_steps": list(self.kept_steps)} if self.kept_steps else {})

    @cached_property
    def key(self) -> str:
        """Identify the question in a log of answers."""
        return key_of(self.body)


def _path_of(request: AnyRequest) -> str:
    if isinstance(request, IdentifyRequest):
        return "/identify"
    if isinstance(request, SimulateRequest):
        return "/simulate"
    return "/plan_multistep" if isinstance(request, MultistepPlanRequest) else "/plan"


def _digest(values: Any) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()


def key_of(body: Mapping[str, Any]) -> str:
    """Return the hash of a question's body, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
