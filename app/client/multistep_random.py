"""The paper's random multi-step evaluation (Table 2), asked over HTTP, paper's numbers beside."""

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.api.schemas import MultistepPlanRequest
from app.client.planner_client import PlannerClient

TARGETS_PER_SEQUENCE = 3
MAX_TARGET_POSITION = 1.0


@dataclass(frozen=True, slots=True)
class PaperRow:
    """What the paper's Table 2 prints for one method and K: means over 150 evaluations."""

    mean_end_error: float
    stuck_steps: float


PAPER = {
    ("action_diffusion", 16): PaperRow(0.17, 23.2),
    ("action_diffusion", 32): PaperRow(0.16, 18.8),
    ("action_diffusion", 128): PaperRow(0.15, 17.1),
    ("action_diffusion", 512): PaperRow(0.13, 15.9),
    ("dataset_prior", 16): PaperRow(0.40, 69.9),
    ("dataset_prior", 32): PaperRow(0.37, 60.7),
    ("dataset_prior", 128): PaperRow(0.31, 46.5),
    ("dataset_prior", 512): PaperRow(0.25, 33.6),
    ("cem", 16): PaperRow(0.49, 105.6),
    ("cem", 32): PaperRow(0.40, 63.0),
    ("cem", 128): PaperRow(0.25, 27.9),
    ("cem", 512): PaperRow(0.14, 22.2),
}


@dataclass(frozen=True, slots=True)
class Result:
    """All answers of one method and K; each array is (sequences * runs,)."""

    label: str
    """What the caller calls the method."""
    method: str
    num_candidates: int
    mean_end_errors: NDArray[np.float64]
    mean_end_floors: NDArray[np.float64]
    final_errors: NDArray[np.float64]
    stuck_steps: NDArray[np.float64]
    compute_ms: NDArray[np.float64]
    """The server's compute time a sequence, waiting apart."""

    @property
    def paper(self) -> PaperRow | None:
        """The paper's row, where it has one."""
        return PAPER.get((self.method, self.num_candidates))


def random_sequences(num_sequences: int, seed: int) -> list[list[tuple[float, float]]]:
    """Draw target sequences: rest positions uniform in [-1, 1] m, by `seed` alone."""
    return [
        [
            (float(position), 0.0)
            for position in np.random.default_rng([seed, sequence]).uniform(
                -MAX_TARGET_POSITION, MAX_TARGET_POSITION, TARGETS_PER_SEQUENCE
            )
        ]
        for sequence in range(num_sequences)
    ]


async def evaluate(
    client: PlannerClient,
    methods: Mapping[str, str | dict[str, Any]],
    budgets: Sequence[int],
    num_sequences: int,
    num_runs: int,
    seed: int,
    refine: bool = False,
) -> AsyncIterator[Result]:
    """Plan every sequence `num_runs` times with every method and K, from rest at 0.

    The sequences and the seeds of the requests are the same for every method and K.

    Args:
        client: the service.
        methods: by what the results call them; a name, or an object as in a request.
        budgets: K.
        num_sequences: of three targets each.
        num_runs: of each sequence.
        seed: decides the sequences and the requests' seeds.
        refine: refine every plan.

    Raises:
        httpx.HTTPError: the service cannot be reached, or refuses a request.
    """
    sequences = random_sequences(num_sequences, seed)

    def request(
        method: str | dict[str, Any], k: int, sequence: int, run: int
    ) -> MultistepPlanRequest:
        request_seed = np.random.SeedSequence([seed, sequence, run]).generate_state(1)[0]
        return MultistepPlanRequest.model_validate(
            {
                "initial_state": (0.0, 0.0),
                "targets": sequences[sequence],
                "method": method,
                "num_candidates": k,
                "seed": int(request_seed),
                "refine": refine,
                "include": [],
            }
        )

    for label, method in methods.items():
        for k in budgets:
            answers = await asyncio.gather(
                *(
                    client.plan_multistep(request(method, k, sequence, run))
                    for sequence in range(num_sequences)
                    for run in range(num_runs)
                )
            )
            yield Result(
                label,
                method if isinstance(method, str) else method["name"],
                k,
                np.array([answer.mean_end_error for answer in answers]),
                np.array([answer.mean_end_floor for answer in answers]),
                np.array([answer.final_error for answer in answers]),
                np.array([float(answer.stuck_steps) for answer in answers]),
                np.array([a.timing_ms.total - a.timing_ms.queue for a in answers]),
            )
