"""How long an evaluation will take, from what the service needs for a few plans just now."""

from statistics import median
from time import perf_counter
from typing import NamedTuple

from app.client.planner_client import AsyncPlannerClient
from app.evaluation.ask import ask
from app.evaluation.entrants import CEM, DIFFUSION, REFINED_PRIOR, UNIFORM
from app.evaluation.question import Question
from app.evaluation.served import ServedModels
from app.planning.problem import Cost
from app.wire.identification import IdentifyRequest
from app.wire.simulation import SimulateRequest

PROBES = 5
SECONDS_PER_SAMPLE = 5e-4
"""Of a log that a machine is identified from, about: it depends on the log more than on ours."""
TASK = {"initial_state": (0.0, 0.0), "target_state": (0.4, 0.0)}


class Rates(NamedTuple):
    """Seconds that a service needs, as a client sees them."""

    plan: float
    """For a plan, whatever the method."""
    network_row: float
    """For one candidate's trip through the network."""
    rollout: float
    refinement: float
    """For refining a plan."""

    def seconds(self, question: Question, cost: Cost) -> float:
        """Estimate how long the answer to `question` takes, which costs so much."""
        request = question.request
        if isinstance(request, IdentifyRequest):
            return SECONDS_PER_SAMPLE * len(request.controls)
        if isinstance(request, SimulateRequest):
            return self.plan + cost.rollouts * self.rollout
        refinement = 0.0 if request.refine is None else self.refinement
        return (
            question.num_plans * (self.plan + refinement)
            + cost.network_evaluations * request.num_candidates * self.network_row
            + cost.rollouts * self.rollout
        )


async def measure_rates(
    client: AsyncPlannerClient, served: ServedModels, *, network: bool
) -> Rates:
    """Ask for a few plans, and see how long they take.

    Args:
        client: the service.
        served: its models.
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

    least, cem, learned, refined = (
        Question({}, entrant.request(TASK, k, seed=0))
        for entrant, k in ((UNIFORM, 1), (CEM, 128), (DIFFUSION, 32), (REFINED_PRIOR, 16))
    )
    plan = await seconds(least)

    async def more(probe: Question) -> float:
        return max(0.0, await seconds(probe) - plan)

    network_row = 0.0
    if network:
        evaluations = served.cost(learned).network_evaluations
        network_row = await more(learned) / (evaluations * learned.plan.num_candidates)
    return Rates(
        plan=plan,
        network_row=network_row,
        rollout=await more(cem) / served.cost(cem).rollouts,
        refinement=await more(refined),
    )
