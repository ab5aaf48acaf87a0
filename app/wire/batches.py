"""Batches: many problems with one way to plan, and a line for each of them."""

from hashlib import blake2b
from typing import Annotated, TypeAlias

from pydantic import ConfigDict, Field, SkipValidation

from app.wire.answers import PlanResponse
from app.wire.model import ARRAY, Asked, WireModel
from app.wire.problems import ProblemDetails
from app.wire.requests import MAX_SEED, InitialState, Seed, Shared, State, SystemField

MAX_PROBLEMS = 10_000
SEED_BYTES = 8


class BatchProblem(Asked):
    """One problem of a batch."""

    initial_state: InitialState
    target_state: State
    seed: Seed | None = Field(
        None,
        description="By default one that follows from the batch's seed and the problem's index; "
        "the line says which.",
    )
    system: SystemField = Field(None, description="By default the batch's.")


class PlanBatchRequest(Shared):
    """Plans for many problems: all but `problems` is as for one plan, and holds for each."""

    problems: Annotated[list[SkipValidation[BatchProblem]], ARRAY] = Field(
        min_length=1,
        max_length=MAX_PROBLEMS,
        description="Each is checked by itself: one at fault is one line that says so.",
    )

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "problems": [
                        {"initial_state": [0.0, 0.0], "target_state": [0.2, 0.0]},
                        {"initial_state": [0.1, 0.0], "target_state": [-0.4, 0.0], "seed": 3},
                    ],
                    "method": "dataset_prior",
                    "refine": True,
                    "seed": 7,
                    "include": [],
                }
            ]
        }
    )


class BatchPlan(PlanResponse):
    """A line of the answer to `POST /plan_batch`: the plan that the problem has alone."""

    index: int = Field(description="Of the problem, from 0; lines come as they are done.")


class BatchFailure(WireModel):
    """A line that says why there is no plan."""

    index: int = Field(description="Of the problem, from 0.")
    problem: ProblemDetails


BatchLine: TypeAlias = Annotated[BatchPlan | BatchFailure, Field(union_mode="left_to_right")]


def problem_seed(seed: int, index: int) -> int:
    """Return the seed of the problem at `index` that names none, in a batch with this `seed`."""
    digest = blake2b(f"{seed}/{index}".encode(), digest_size=SEED_BYTES).digest()
    return int.from_bytes(digest) & MAX_SEED
