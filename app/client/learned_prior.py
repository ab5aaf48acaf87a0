"""What the learned prior buys once every method is refined: the same tasks for all, paired.

Success is to end within 1e-3 of the floor, exactness within 1e-6. Energy, roughness and stuck steps
are those of the plans answered, whether they succeed or not.
"""

import asyncio
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.api.schemas import PlanRequest, PlanResponse
from app.client.planner_client import PlannerClient
from app.client.statistics import paired_difference

SUCCESS_GAP = 1e-3
EXACT_GAP = 1e-6
BUDGETS = (1, 4, 16)
MEASURES = ("success", "exact", "energy", "roughness", "stuck steps")

METHODS = ("action_diffusion", "dataset_prior", "uniform")
CONTROL = "dataset_prior"
EQUAL_TIME_BUDGETS = (64, 256, 1024)
"""K of the dataset prior among which the one that takes as long as action_diffusion is read off."""


@dataclass(frozen=True, slots=True)
class Entrant:
    """A method, its K and what refinement may do."""

    method: str
    num_candidates: int
    repair: bool
    objective: str = "terminal_error"


@dataclass(frozen=True, slots=True)
class Outcome:
    """One entrant's measures on every task."""

    entrant: Entrant
    measures: dict[str, NDArray[np.float64]]
    """Each of `MEASURES`, (tasks,)."""
    compute_ms: NDArray[np.float64]


def entrants() -> Iterator[Entrant]:
    """List who takes part: first by descent alone, then with repair, then for the least energy."""
    for repair in (False, True):
        for k in BUDGETS:
            for method in METHODS:
                yield Entrant(method, k, repair)
    for k in BUDGETS:
        yield Entrant("action_diffusion", k, repair=True, objective="control_energy")
    for k in (*BUDGETS, *EQUAL_TIME_BUDGETS):
        yield Entrant(CONTROL, k, repair=True, objective="control_energy")


def tasks(num_tasks: int, seed: int) -> list[dict[str, tuple[float, float]]]:
    """Draw starts from the training range, and targets in [-1, 1] m, every other moving."""
    drawn = []
    for task in range(num_tasks):
        rng = np.random.default_rng([seed, task])
        start = (float(rng.uniform(-1, 1)), float(rng.uniform(-0.5, 0.5)))
        velocity = float(rng.uniform(-0.5, 0.5)) if task % 2 else 0.0
        drawn.append(
            {"initial_state": start, "target_state": (float(rng.uniform(-1, 1)), velocity)}
        )
    return drawn


async def evaluate(client: PlannerClient, num_tasks: int, seed: int) -> AsyncIterator[Outcome]:
    """Let every entrant plan every task, with the same seeds.

    Raises:
        httpx.HTTPError: the service cannot be reached, or refuses a request.
    """
    for entrant in entrants():
        requests = [
            PlanRequest.model_validate(
                task
                | {
                    "method": entrant.method,
                    "num_candidates": entrant.num_candidates,
                    "seed": index,
                    "refine": {"repair": entrant.repair},
                    "objective": entrant.objective,
                    "include": [],
                }
            )
            for index, task in enumerate(tasks(num_tasks, seed))
        ]
        answers = await asyncio.gather(*(client.plan(request) for request in requests))
        yield _outcome(entrant, answers)


def _outcome(entrant: Entrant, answers: list[PlanResponse]) -> Outcome:
    columns = (
        [float(answer.gap < SUCCESS_GAP) for answer in answers],
        [float(answer.gap < EXACT_GAP) for answer in answers],
        [answer.control_energy for answer in answers],
        [answer.control_smoothness for answer in answers],
        [float(answer.stuck_steps) for answer in answers],
    )
    return Outcome(
        entrant,
        {name: np.array(column) for name, column in zip(MEASURES, columns, strict=True)},
        np.array([answer.timing_ms.total - answer.timing_ms.queue for answer in answers]),
    )


def report(outcomes: list[Outcome]) -> Iterator[str]:
    """Write the table, and what action_diffusion buys over the dataset prior at the same K."""
    yield f"| refined by | method | K | {' | '.join(MEASURES)} | ms (median) |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    for outcome in outcomes:
        entrant, measures = outcome.entrant, outcome.measures
        yield (
            f"| {_refined_by(entrant)} | `{entrant.method}` | {entrant.num_candidates} "
            f"| {measures['success'].mean():.1%} | {measures['exact'].mean():.1%} "
            f"| {measures['energy'].mean():.1f} | {measures['roughness'].mean():.2f} "
            f"| {measures['stuck steps'].mean():.1f} "
            f"| {np.median(outcome.compute_ms):.2f} |"
        )
    yield ""
    yield "action_diffusion less dataset_prior at the same K, paired, with 95 % intervals:"
    yield ""
    yield f"| refined by | K | {' | '.join(MEASURES)} |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    found = {outcome.entrant: outcome for outcome in outcomes}
    for entrant, outcome in found.items():
        control = Entrant(CONTROL, entrant.num_candidates, entrant.repair, entrant.objective)
        if entrant.method != "action_diffusion":
            continue
        cells = (
            paired_difference(outcome.measures[measure], found[control].measures[measure])
            for measure in MEASURES
        )
        row = " | ".join(f"{mean:+.3f} [{low:+.3f}, {high:+.3f}]" for mean, low, high in cells)
        yield f"| {_refined_by(entrant)} | {entrant.num_candidates} | {row} |"


def _refined_by(entrant: Entrant) -> str:
    if entrant.objective != "terminal_error":
        return "descent, repair, least energy"
    return "descent and repair" if entrant.repair else "descent alone"
