"""How long an evaluation will take, from what the service needs for a few plans just now."""

from dataclasses import dataclass
from statistics import median
from time import perf_counter

from app.client.planner_client import AsyncPlannerClient
from app.evaluation.ask import ask
from app.evaluation.question import Question
from app.wire.requests import PlanRequest

PROBES = 5


@dataclass(frozen=True, slots=True)
class Rates:
    """Seconds that a service needs, as a client sees them."""

    plan: float
    """For a plan, whatever the method."""
    network_row: float
    """For one candidate's trip through the network."""
    rollout: float
    refinement: float
    """For refining a plan."""

    def seconds(self, question: Question) -> float:
        """Estimate how long the answer to `question` takes."""
        cost = question.cost
        return (
            question.num_plans * (self.plan + self.refinement * bool(question.request.refine))
            + cost.network_evaluations * question.request.num_candidates * self.network_row
            + cost.rollouts * self.rollout
        )


async def measure_rates(client: AsyncPlannerClient, *, network: bool) -> Rates:
    """Ask for a few plans, and see how long they take.

    Args:
        client: the service.
        network: whether the network matters; it takes a model of the nominal plant.

    Raises:
        RequestRefused: the service says no.
        httpx.TransportError: it cannot be reached.
    """

    async def seconds(probe: Question) -> float:
        times = []
        for _ in range(PROBES):
            started = perf_counter()
            await ask(client, probe)
            times.append(perf_counter() - started)
        return median(times)

    least = await seconds(_probe("uniform", 1))
    cem, refined = _probe("cem", 128), _probe("dataset_prior", 16, refine=True)
    row = 0.0
    if network:
        learned = _probe("action_diffusion", 32)
        rows = learned.cost.network_evaluations * learned.request.num_candidates
        row = max(0.0, await seconds(learned) - least) / rows
    return Rates(
        plan=least,
        network_row=row,
        rollout=max(0.0, await seconds(cem) - least) / cem.cost.rollouts,
        refinement=max(0.0, await seconds(refined) - least),
    )


def _probe(method: str, num_candidates: int, refine: bool = False) -> Question:
    fields = {
        "initial_state": (0.0, 0.0),
        "target_state": (0.4, 0.0),
        "method": method,
        "num_candidates": num_candidates,
        "refine": refine,
        "seed": 0,
        "include": [],
    }
    return Question({}, PlanRequest.model_validate(fields))
