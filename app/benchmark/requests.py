"""What HTTP, validation and threads add to a plan, beside a request that asks for nothing."""

import json
from collections.abc import Iterator
from contextlib import closing
from statistics import median

from app.benchmark.connections import CONNECTIONS, Connection, rate, written
from app.launch import launch

ROUNDS, CALLS = 20, 20
REQUESTS_EACH = 60
PLAN = {
    "initial_state": [0.0, 0.0],
    "target_state": [0.5, 0.0],
    "seed": 1,
    "method": "dataset_prior",
    "refine": True,
    "reachability": False,
    "include": [],
}


def requests() -> Iterator[str]:
    """Ask in turns for a plan and whether the service lives; yield a Markdown list."""
    livez, plan = written("GET", "/livez"), written("POST", "/plan", PLAN)
    # With its log, which is a part of what a request takes.
    with (
        launch("app", "serve", "--log-format", "json") as server,
        closing(Connection(server.url)) as connection,
    ):
        nothing, beyond = list[float](), list[float]()
        for number in range(ROUNDS + 1):
            for _ in range(CALLS):
                took, _ = connection.ask(livez)
                nothing.append(took)
            for _ in range(CALLS):
                took, answer = connection.ask(plan)
                beyond.append(took - json.loads(answer)["timing_ms"]["total"])
            if number == 0:  # the first ones load what later ones have
                nothing, beyond = [], []
        yield (
            f"- /livez: {median(nothing):.2f} ms; /plan (dataset_prior, refined, without the "
            f"floor) beyond its own total: {median(beyond):.2f} ms, ratio "
            f"{median(beyond) / median(nothing):.2f}"
        )
        for count in (1, CONNECTIONS):
            plans = rate(server.url, [plan] * (count * REQUESTS_EACH), count)
            yield f"- the same over {count} connections: {plans:.0f} plans/s"
