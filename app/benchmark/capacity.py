"""How many plans a second a core makes over HTTP, by what is asked for."""

from collections.abc import Iterator
from statistics import median
from typing import Any, NamedTuple

import psutil

from app.benchmark.batches import REFINED
from app.benchmark.connections import CONNECTIONS, rate, written
from app.evaluation.tasks import DrawTasks, sequence_tasks, transition_tasks
from app.launch import ServerProcess, launch

ROUNDS, REQUESTS = 5, 160
"""Of each kind, in turns, and of a round."""
NUM_CANDIDATES = 16
SHARES = {"static_friction": 0.1, "coulomb_friction": 0.1, "viscous_damping": 0.1}
"""How far an uncertain plant may be off."""


class Kind(NamedTuple):
    """What requests ask for: each has a task and a seed of its own."""

    name: str
    fields: dict[str, Any]
    path: str = "/plan"
    draw_tasks: DrawTasks = transition_tasks
    plans_each: int = 1


class Measured(NamedTuple):
    """What a round of a kind came to."""

    plans_per_second: float
    cpu_ms: float
    """Of the service, for a plan."""


KINDS = (
    Kind("dataset_prior, refined", REFINED),
    Kind("cem", {"method": "cem"}),
    Kind("action_diffusion", {}),
    Kind(
        "dataset_prior, refined, `uncertainty` of 10 %",
        REFINED | {"uncertainty": {"relative": SHARES}},
    ),
    Kind("action_diffusion, three targets", {}, "/plan_multistep", sequence_tasks, plans_each=3),
)


def capacity() -> Iterator[str]:
    """Ask a service for each kind of plan over many connections; yield a Markdown table."""
    # With its log, which is a part of what a plan takes.
    with launch("app", "serve", "--log-format", "json") as server:
        rounds = [[_measure(server, kind) for kind in KINDS] for _ in range(ROUNDS + 1)]
    yield (
        f"| K = {NUM_CANDIDATES}, {CONNECTIONS} connections | plans/s | processor time of the "
        "service a plan | plans/s a core |"
    )
    yield "| --- | ---: | ---: | ---: |"
    # The first ones load what later ones have.
    for kind, measured in zip(KINDS, zip(*rounds[1:], strict=True), strict=True):
        plans_per_second, cpu_ms = map(median, zip(*measured, strict=True))
        yield f"| {kind.name} | {plans_per_second:.0f} | {cpu_ms:.2f} ms | {1e3 / cpu_ms:.0f} |"


def _measure(server: ServerProcess, kind: Kind) -> Measured:
    process = psutil.Process(server.process.pid)
    shared = {"num_candidates": NUM_CANDIDATES, "include": [], **kind.fields}
    requests = [
        written("POST", kind.path, {**shared, **task, "seed": seed})
        for seed, task in enumerate(kind.draw_tasks(REQUESTS, 0))
    ]
    before = process.cpu_times()
    requests_per_second = rate(server.url, requests, CONNECTIONS)
    after = process.cpu_times()
    seconds = after.user - before.user + after.system - before.system
    return Measured(
        requests_per_second * kind.plans_each, 1e3 * seconds / (REQUESTS * kind.plans_each)
    )
