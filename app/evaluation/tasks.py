"""The random tasks, and the seeds of requests: by the suite's seed alone, never by method or K."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

Task: TypeAlias = Mapping[str, Any]
"""Fields of a request: where it starts, its target or targets, and what else all methods share."""
DrawTasks: TypeAlias = Callable[[int, int], Sequence[Task]]
"""Draws so many tasks with a seed: more of them begin with the same ones."""

REST = (0.0, 0.0)
"""At the origin, at rest."""
TARGETS_PER_SEQUENCE = 3
MAX_POSITION = 1.0
MAX_VELOCITY = 0.5
"""Of the training data's initial states (paper, Table 2), m and m/s."""


def one_task(**fields: Any) -> DrawTasks:
    """Draw always the same task, from rest."""
    return lambda *_: [{"initial_state": REST, **fields}]


def sequence_tasks(num_tasks: int, seed: int) -> list[Task]:
    """Draw sequences of targets from rest: at rest, uniform in [-1, 1] m (paper, Table 2)."""
    tasks: list[Task] = []
    for task in range(num_tasks):
        rng = np.random.default_rng([seed, task])
        positions = rng.uniform(-MAX_POSITION, MAX_POSITION, TARGETS_PER_SEQUENCE)
        targets = [(position, 0.0) for position in positions.tolist()]
        tasks.append({"initial_state": REST, "targets": targets})
    return tasks


def transition_tasks(num_tasks: int, seed: int) -> list[Task]:
    """Draw starts from the training range, and targets from it too, every other one at rest."""
    tasks: list[Task] = []
    for task in range(num_tasks):
        rng = np.random.default_rng([seed, task])
        start = rng.uniform(-MAX_POSITION, MAX_POSITION), rng.uniform(-MAX_VELOCITY, MAX_VELOCITY)
        velocity = rng.uniform(-MAX_VELOCITY, MAX_VELOCITY) if task % 2 else 0.0
        target = rng.uniform(-MAX_POSITION, MAX_POSITION), velocity
        tasks.append({"initial_state": start, "target_state": target})
    return tasks


def request_seed(seed: int, task: int, run: int) -> int:
    """Return the seed of the request for one run of a task: common to all methods and K."""
    return int(np.random.SeedSequence([seed, task, run]).generate_state(1)[0])
