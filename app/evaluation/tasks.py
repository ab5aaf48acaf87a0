"""The random tasks, and the seeds of requests: by the suite's seed alone, never by method or K."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON

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
FARTHEST = 0.5
"""Targets of a machine lie within this share of its reach."""
FASTEST = 0.3
"""Starts and targets of a machine move with up to this share of its speed."""


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


class Scale(NamedTuple):
    """How far a machine gets within the horizon, and how fast it is then."""

    reach: float
    """Half of the width between where full control to either side leads from rest, m (or rad)."""
    speed: float
    """Half of the difference between the velocities there, m/s (or rad/s)."""


@cache
def scale_of(system: System) -> Scale:
    """Return how far full control both ways takes a mass from rest in the default horizon."""
    full = np.array([[system.plant.lowest_control], [system.plant.highest_control]])
    states = rollout(system, np.array(REST), full.repeat(DEFAULT_HORIZON, axis=1))
    lowest, highest = states[:, -1]
    reach, speed = (highest - lowest) / 2
    return Scale(float(reach), float(speed))


def machine_tasks(system: System) -> DrawTasks:
    """Draw starts and targets for a machine, in proportion to its scale, and the machine itself.

    Every other task starts at rest, and of each eight two targets move. Velocities are uniform in
    +-0.3 of the machine's speed, m/s (or rad/s), displacements in +-0.5 of its reach, m (or rad).
    The shares are the same for all machines, whose tasks are thus alike.
    """
    reach, speed = scale_of(system)

    def draw(num_tasks: int, seed: int) -> list[Task]:
        tasks: list[Task] = []
        for task in range(num_tasks):
            rng = np.random.default_rng([seed, task])
            displacement = reach * rng.uniform(-FARTHEST, FARTHEST)
            start, target = (speed * rng.uniform(-FASTEST, FASTEST, 2)).tolist()
            tasks.append(
                {
                    "system": system,
                    "initial_state": (0.0, start if task % 2 else 0.0),
                    # Of the first two of each eight one starts at rest and one moving.
                    "target_state": (displacement, 0.0 if task % 8 // 2 else target),
                }
            )
        return tasks

    return draw


def request_seed(seed: int, task: int, run: int) -> int:
    """Return the seed of the request for one run of a task: common to all methods and K."""
    return int(np.random.SeedSequence([seed, task, run]).generate_state(1)[0])
