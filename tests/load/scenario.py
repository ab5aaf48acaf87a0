"""What is asked: a seeded mix of requests of all methods and sizes, each known by its number."""

import random
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS
from app.planning.problem import DEFAULT_HORIZON
from app.wire.requests import PlanRequest

SECONDS_PER_ROW = 8e-5
"""Of a row through the network, about, where both cores are free."""
SECONDS_PER_STEP = 2e-8
SECONDS_PER_PLAN = 2e-3
PATIENCE_SECONDS = (0.3, 1.5)
"""Who asks for something small wants it soon, if not at once."""
LONGEST_DEADLINE_SECONDS = 5.0
MOST_CANDIDATES_SENT = 64
SHARE_MULTISTEP = 0.15
LONGEST_MULTISTEP_SECONDS = 0.3
"""Of one of its plans: larger ones are asked for alone."""
REACH = 0.6
"""m: starts and targets lie this far from zero at most, so that most targets can be reached."""

Body: TypeAlias = dict[str, Any]


class Question(NamedTuple):
    """A request of the mix."""

    route: str
    body: Body
    rows: int
    """Through the network."""
    seconds: float
    """About how long it takes alone."""
    deadline_ms: int
    """One that suits its size; it is not in the body."""


def question(seed: int, index: int) -> Question:
    """Return request number `index` of the mix."""
    rng = random.Random(f"{seed} {index}")
    body = rng.choices(KINDS, [weight for weight, _ in KINDS])[0][1](rng)
    body |= {
        "initial_state": rng.choice([[0.0, 0.0], _state(rng)]),
        "target_state": _state(rng),
        "seed": rng.getrandbits(32),
        "include": rng.choices([[], ["states"], ["candidates"]], [70, 25, 5])[0],
    }
    if body["num_candidates"] > MOST_CANDIDATES_SENT and "candidates" in body["include"]:
        body["include"] = []
    rows, seconds = _size(PlanRequest.model_validate(body))
    route = "/plan"
    if seconds <= LONGEST_MULTISTEP_SECONDS and rng.random() < SHARE_MULTISTEP:
        body["targets"] = [body.pop("target_state")] + [
            _state(rng) for _ in range(rng.randint(1, 3))
        ]
        route, num_targets = "/plan_multistep", len(body["targets"])
        rows, seconds = rows * num_targets, seconds * num_targets
    patience = rng.uniform(*PATIENCE_SECONDS) + rng.uniform(2, 20) * seconds
    deadline = min(LONGEST_DEADLINE_SECONDS, patience)
    return Question(route, body, rows, seconds, round(1e3 * deadline))


def _size(request: PlanRequest) -> tuple[int, float]:
    """Return the rows that a plan sends through the network, and about how long it takes (s)."""
    k = request.num_candidates
    # All models that the load test serves are of the paper's kind.
    cost = request.recipe().settled(PAPER_MODEL_SAMPLERS).cost()
    rows = k * cost.network_evaluations
    steps = cost.rollouts * (request.horizon or DEFAULT_HORIZON)
    return rows, SECONDS_PER_PLAN + SECONDS_PER_ROW * rows + SECONDS_PER_STEP * steps


def _state(rng: random.Random) -> list[float]:
    return [round(rng.uniform(-REACH, REACH), 3), 0.0]


def _candidates(rng: random.Random, sizes: Sequence[int]) -> int:
    """Return one of `sizes`; each is a little rarer than the next smaller one."""
    return rng.choices(sizes, [0.8**rank for rank in range(len(sizes))])[0]


def _default(rng: random.Random) -> Body:
    k = _candidates(rng, [16, 1, 4, 8, 32, 64, 128, 256, 512])
    return {"method": "action_diffusion", "num_candidates": k}


def _ddim(rng: random.Random) -> Body:
    method = {
        "name": "action_diffusion",
        "sampler": "ddim",
        "steps": rng.randint(2, 20),
        "guidance_scale": rng.choice([0.0, 1.0, 1.5, 2.0]),
    }
    return {"method": method, "num_candidates": _candidates(rng, [8, 1, 16, 32, 64])}


def _paper(rng: random.Random) -> Body:
    method = {"name": "action_diffusion", "sampler": "paper"}
    # 512 of them take seconds: once in a while.
    sizes, weights = [1, 2, 4, 16, 64, 512], [32, 24, 24, 16, 3, 1]
    return {"method": method, "num_candidates": rng.choices(sizes, weights)[0]}


def _random_shooting(rng: random.Random) -> Body:
    k = _candidates(rng, [16, 64, 256, 512])
    return {"method": rng.choice(["dataset_prior", "uniform"]), "num_candidates": k} | _plant(rng)


def _optimiser(rng: random.Random) -> Body:
    k = _candidates(rng, [16, 32, 64, 128, 512])
    return {"method": rng.choice(["cem", "icem", "mppi"]), "num_candidates": k} | _plant(rng)


def _refined(rng: random.Random) -> Body:
    learned = {"name": "action_diffusion", "steps": 1}
    return {
        "method": rng.choice([learned, "dataset_prior", "cem", "uniform"]),
        "num_candidates": _candidates(rng, [4, 1, 16]),
        "refine": rng.choice([True, {"iterations": 10, "repair": False}]),
        "objective": rng.choice(["terminal_error", "terminal_error", "control_energy"]),
    }


def _started(rng: random.Random) -> Body:
    optimiser = {"name": rng.choice(["cem", "icem", "mppi"]), "iterations": rng.randint(5, 20)}
    return {
        "method": optimiser,
        "initial": {"method": rng.choice(["action_diffusion", "dataset_prior"])},
        "num_candidates": _candidates(rng, [16, 32, 64]),
    }


def _plant(rng: random.Random) -> Body:
    """Return another plant and horizon, now and then; no model was trained for them."""
    if rng.random() < 0.7:
        return {}
    system = {"static_friction": rng.choice([0.65, 0.75]), "viscous_damping": 0.1}
    return {"system": system, "horizon": rng.choice([32, 64, 100])}


KINDS: list[tuple[int, Callable[[random.Random], Body]]] = [
    (32, _default),
    (10, _ddim),
    (4, _paper),
    (16, _random_shooting),
    (16, _optimiser),
    (12, _refined),
    (10, _started),
]
"""The kinds of request, with their weights."""
