"""The service as a client sees it: its start, what engine and HTTP add to a plan, its memory."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from http import HTTPStatus
from http.client import HTTPConnection

import numpy as np
import psutil

from app.benchmark.pairing import paired
from app.benchmark.quick_plans import METHOD as QUICK
from app.benchmark.quick_plans import NUM_CANDIDATES as QUICK_CANDIDATES
from app.inference.model import Model
from app.inference.sampling import sample_alone
from app.launch import launch
from app.planning.arrays import FloatArray
from app.planning.methods import CEM, ActionDiffusion
from app.planning.methods.base import Finish
from app.planning.methods.sampler import Sampler
from app.planning.planner import plan
from app.planning.problem import Candidates, Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement

PAIRS, CALLS = 12, 20


class BareProposal:
    """A `LearnedProposal` without an engine: solver and network, in this thread.

    Args:
        model: that it samples from.
    """

    def __init__(self, model: Model) -> None:
        self._model = model

    def begin(self, problem: Problem, noise: FloatArray, sampler: Sampler) -> Finish:
        """Denoise `noise` (K, H) into controls (K, H), when they are asked for."""
        return lambda: Candidates(sample_alone(self._model, problem, noise, sampler))


def service(model: Model) -> Iterator[str]:
    """Start a service, ask it for plans, and the planner in this process for the same.

    Yields a Markdown list.
    """
    with launch("app", "serve", "--log-level", "error") as server:
        # Python's own client takes a millisecond less of its own than httpx.
        connection = HTTPConnection(server.url.removeprefix("http://"))
        yield f"- start to ready: {server.start_seconds:.1f} s"
        yield _request(connection, CEM(), 16, model)
        yield _request(connection, ActionDiffusion(), 16, model)
        yield _request(connection, QUICK, QUICK_CANDIDATES, model, Refinement())
        connection.close()
        memory = psutil.Process(server.process.pid).memory_info().rss / 2**20
        yield f"- resident memory of the service afterwards: {memory:.0f} MiB"


def _request(
    connection: HTTPConnection,
    method: CEM | ActionDiffusion,
    num_candidates: int,
    model: Model,
    refinement: Refinement | None = None,
) -> str:
    problem = Problem(np.zeros(2), np.array([0.5, 0.0]))
    asked = Recipe(method, num_candidates, refinement, reachability=True)
    recipe = asked.settled(model.manifest.samplers).able(BareProposal(model))
    request = {
        "initial_state": [0.0, 0.0],
        "target_state": [0.5, 0.0],
        "method": asdict(method),
        "num_candidates": num_candidates,
        "seed": 0,
        "refine": refinement is not None,
    }
    body = json.dumps(request)

    def ask() -> None:
        connection.request("POST", "/plan", body, {"Content-Type": "application/json"})
        answer = connection.getresponse()
        answer.read()
        assert answer.status == HTTPStatus.OK

    def plan_alone() -> None:
        plan(problem, recipe, np.random.default_rng(0))

    over_http, in_process = (
        ms / CALLS for ms in paired(lambda: _repeat(ask), lambda: _repeat(plan_alone), PAIRS)
    )
    return (
        f"- {method.name}{', refined' if refinement else ''}, K = {num_candidates}, "
        f"{recipe.cost().network_evaluations} evaluations: {over_http:.2f} ms over "
        f"HTTP, {in_process:.2f} ms by the planner alone; engine and HTTP add "
        f"{over_http - in_process:.2f} ms"
    )


def _repeat(call: Callable[[], None]) -> None:
    """Call many times in a row: alone, neither drives the other's code out of the caches."""
    for _ in range(CALLS):
        call()
