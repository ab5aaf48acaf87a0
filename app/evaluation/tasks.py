"""The random tasks, and the seeds of requests: by the suite's seed alone, never by method or K."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, System
from app.planning.problem import DEFAULT_HORIZON, Problem
from app.planning.reachable.reachability import reachability

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

HALF, STRIBECK = 0.5, 0.1
"""Shares of random machines."""


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


def reachable_tasks(num_tasks: int, seed: int) -> list[Task]:
    """Draw starts as `transition_tasks` does, and targets at rest within reach of the horizon."""
    tasks: list[Task] = []
    for task in range(num_tasks):
        rng = np.random.default_rng([seed, task])
        while True:
            position, target = rng.uniform(-MAX_POSITION, MAX_POSITION, 2).tolist()
            start = position, float(rng.uniform(-MAX_VELOCITY, MAX_VELOCITY))
            if reachability(Problem(np.array(start), np.array([target, 0.0]))).reachable:
                break
        tasks.append({"initial_state": start, "target_state": (target, 0.0)})
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

    def draw(num_tasks: int, seed: int) -> list[Task]:
        return [
            _machine_task(system, task, np.random.default_rng([seed, task]))
            for task in range(num_tasks)
        ]

    return draw


def random_machine_tasks(num_tasks: int, seed: int) -> list[Task]:
    """Draw a machine for each task, and the task as `machine_tasks` does."""
    tasks = []
    for task in range(num_tasks):
        rng = np.random.default_rng([seed, task])
        tasks.append(_machine_task(random_machine(rng), task, rng))
    return tasks


def _machine_task(system: System, task: int, rng: np.random.Generator) -> Task:
    reach, speed = scale_of(system)
    displacement = reach * rng.uniform(-FARTHEST, FARTHEST)
    start, target = (speed * rng.uniform(-FASTEST, FASTEST, 2)).tolist()
    return {
        "system": system,
        "initial_state": (0.0, start if task % 2 else 0.0),
        # Of the first two of each eight one starts at rest and one moving.
        "target_state": (displacement, 0.0 if task % 8 // 2 else target),
    }


def random_machine(rng: np.random.Generator) -> System:
    """Draw a machine out of all that there are, whose horizon lasts 1 to 5 s.

    Static friction takes 2 to 90 % of what full control makes of the mass, Coulomb friction 30 to
    100 % of that, the bias up to 20 % for every other machine. Every other one has other frictions
    backward, of half to twice those forward, and one of ten has Stribeck's effect. Damping times
    the horizon is up to 40, half of the machines less than 4. Gains, limits and units are any.
    """
    gain, limit = np.exp(rng.uniform(np.log([0.1, 0.5]), np.log([10.0, 20.0]))).tolist()
    full, time_step = gain * limit, _log_uniform(0.016, 0.08, rng)
    ratios = np.exp(rng.uniform(-1, 1, 2) * np.log(2) * (rng.random() < HALF)).tolist()
    static = float(rng.uniform(0.02 * max(1.0, 1 / ratios[0]), 0.9 * min(1.0, 1 / ratios[0])))
    shares = rng.uniform(0.3, 1.0, 2).tolist() if max(ratios) > 1 else [rng.uniform(0.3, 1.0)] * 2
    most = (40.0 if rng.random() < HALF else 4.0) / DEFAULT_HORIZON
    damping = float(rng.uniform(0, most / max(1.0, ratios[1])))
    step = full * time_step
    return System(
        static_friction=ByDirection(full * static, full * static * ratios[0]),
        coulomb_friction=ByDirection(
            full * static * shares[0], full * static * ratios[0] * shares[1]
        ),
        viscous_damping=ByDirection(damping / time_step, damping * ratios[1] / time_step),
        stribeck_velocity=step * _log_uniform(0.1, 10.0, rng) if rng.random() < STRIBECK else None,
        bias=full * float(rng.uniform(-0.2, 0.2)) if rng.random() < HALF else 0.0,
        control_gain=gain,
        control_limit=limit,
        time_step=time_step,
        velocity_threshold=step * _log_uniform(0.003, 0.1, rng),
    )


def _log_uniform(low: float, high: float, rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log([low, high]))))


def request_seed(seed: int, task: int, run: int) -> int:
    """Return the seed of the request for one run of a task: common to all methods and K."""
    return int(np.random.SeedSequence([seed, task, run]).generate_state(1)[0])
