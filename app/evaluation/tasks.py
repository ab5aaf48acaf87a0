"""The random tasks, and the seeds of requests: by the suite's seed alone, never by method or K."""

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

State: TypeAlias = tuple[float, float]
Task: TypeAlias = Mapping[str, Any]
"""Fields of a request: where it starts, its target or targets, and what else all methods share."""

REST = (0.0, 0.0)
"""At the origin, at rest."""
TARGETS_PER_SEQUENCE = 3
MAX_POSITION = 1.0
MAX_VELOCITY = 0.5
"""Of the training data's initial states (paper, Table 2), m and m/s."""


class Transition(NamedTuple):
    """From a start to a target, both position (m) and velocity (m/s)."""

    initial_state: State
    target_state: State


def random_sequences(num_sequences: int, seed: int) -> list[list[State]]:
    """Draw sequences of targets: rest positions, uniform in [-1, 1] m (paper, Table 2)."""
    return [
        [
            (float(position), 0.0)
            for position in np.random.default_rng([seed, sequence]).uniform(
                -MAX_POSITION, MAX_POSITION, TARGETS_PER_SEQUENCE
            )
        ]
        for sequence in range(num_sequences)
    ]


def random_transitions(num_transitions: int, seed: int) -> list[Transition]:
    """Draw starts from the training range, and targets from it too, every other one at rest."""
    drawn = []
    for task in range(num_transitions):
        rng = np.random.default_rng([seed, task])
        start = (_uniform(rng, MAX_POSITION), _uniform(rng, MAX_VELOCITY))
        velocity = _uniform(rng, MAX_VELOCITY) if task % 2 else 0.0
        drawn.append(Transition(start, (_uniform(rng, MAX_POSITION), velocity)))
    return drawn


def sequence_tasks(num_tasks: int, seed: int) -> list[Task]:
    """Return the random sequences as tasks, from rest."""
    sequences = random_sequences(num_tasks, seed)
    return [{"initial_state": REST, "targets": targets} for targets in sequences]


def transition_tasks(num_tasks: int, seed: int) -> list[Task]:
    """Return the random transitions as tasks."""
    return [transition._asdict() for transition in random_transitions(num_tasks, seed)]


def request_seed(seed: int, task: int, run: int) -> int:
    """Return the seed of the request for one run of a task: common to all methods and K."""
    return int(np.random.SeedSequence([seed, task, run]).generate_state(1)[0])


def _uniform(rng: np.random.Generator, limit: float) -> float:
    return float(rng.uniform(-limit, limit))
