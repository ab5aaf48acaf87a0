"""What a model covers: ranges of features of plants and tasks, and the plants in words."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self, TypeAlias

from app.planning.options import Options
from app.planning.plant.features import (
    CHANGES,
    PLANT_FEATURES,
    TASK_FEATURES,
    PlantFacts,
    TaskFacts,
)
from app.planning.plant.system import System
from app.planning.plant.task import Task

Bounds: TypeAlias = tuple[float, float]
"""Least and greatest value, both included."""


@dataclass(frozen=True, slots=True)
class Coverage(Options):
    """Plants whose every named feature lies within its bounds, and tasks as far as theirs go."""

    ranges: dict[str, Bounds]
    """By the names of `PLANT_FEATURES`, and of those of a task that can be changed (`CHANGES`)."""

    def check_combination(self) -> None:
        """Check names and order.

        Raises:
            ValueError: no feature that may have a range is called so, a lower bound exceeds its
                upper one, or no range is of plants.
        """
        for name, (low, high) in self.ranges.items():
            if name not in PLANT_FEATURES and name not in CHANGES:
                raise ValueError(f"there are no ranges of {name!r}")
            if not -math.inf < low <= high < math.inf:
                raise ValueError(f"{name} is a range from {low} to {high}")
        if not self.plants:
            raise ValueError("a coverage says which plants are covered")

    @classmethod
    def only(cls, system: System) -> Self:
        """Return what covers one plant."""
        return cls({name: (value, value) for name, value in system.plant._asdict().items()})

    @property
    def plants(self) -> dict[str, Bounds]:
        """The ranges that say which plants are covered."""
        return {name: self.ranges[name] for name in self.ranges if name in PLANT_FEATURES}

    def covers(self, system: System, horizon: int) -> bool:
        """Say whether a plant is covered; some of its features are by the horizon H."""
        facts = PlantFacts(system.plant, horizon)
        return all(
            low <= PLANT_FEATURES[name](facts) <= high
            for name, (low, high) in self.ranges.items()
            if name in PLANT_FEATURES
        )

    def nearest(self, task: Task, horizon: int) -> Task:
        """Return a task that goes no further than the ranges: where one does, to their end."""
        facts = TaskFacts(task, horizon)
        for name, (low, high) in self.ranges.items():
            if name in TASK_FEATURES:
                value = TASK_FEATURES[name](facts)
                if not low <= value <= high:
                    nearer = CHANGES[name](facts, low if value < low else high)
                    facts = TaskFacts(nearer, horizon)
        return facts.task

    def __str__(self) -> str:
        """Write each feature of the plants as a number, or as a range."""
        return ", ".join(_phrases(self.plants))


def in_words(bounds: Bounds, unit: float = 1.0) -> str:
    """Write bounds as a range, or as a number where they are one; in so many of the unit."""
    low, high = (f"{bound / unit:g}" for bound in bounds)
    return low if low == high else f"{low} to {high}"


PERCENT = 0.01
STEP = "the velocity that full control adds in a step"
_WAYS = ("forward", "backward")
_FRICTIONS = ("static_{}", "coulomb_{}", "damping_{}")
_WORDS: tuple[tuple[str, str, float], ...] = (
    ("static_{}", "static_friction {}", 1.0),
    ("coulomb_{}", "coulomb_friction {}", 1.0),
    ("damping_{}", "viscous_damping {}", 1.0),
    ("control_limit", "control_limit {}", 1.0),
    ("static_{}_over_limit", "static friction {} % of the limit", PERCENT),
    ("static_backward_over_forward", "static friction backward {} times that forward", 1.0),
    ("coulomb_{}_over_limit", "Coulomb friction {} % of the limit", PERCENT),
    ("coulomb_over_static_{}", "Coulomb friction {} % of static friction", PERCENT),
    ("damping_{}_times_horizon", "viscous damping {} over the horizon's duration", 1.0),
    ("bias_over_limit", "bias {} % of the limit", PERCENT),
    ("velocity_threshold_over_step", f"velocity threshold {{}} % of {STEP}", PERCENT),
    ("stribeck_over_step", f"Stribeck velocity {{}} times {STEP}", 1.0),
)
"""A feature of each direction or of none, the words around its range, and the range's unit."""
_LACKING: dict[str, tuple[Bounds, str]] = {
    "bias": ((0.0, 0.0), "bias"),
    "control_gain": ((1.0, 1.0), "gain"),
    "stribeck_velocity": ((0.0, 0.0), "Stribeck effect"),
}
"""What the paper's plant lacks: the value that says so, and its word."""


def _phrases(ranges: dict[str, Bounds]) -> Iterator[str]:
    """Yield what the plants have, and then what they lack."""
    # Breakaway friction follows from the others.
    left = {name: bounds for name, bounds in ranges.items() if not name.startswith("breakaway")}
    lacking = [name for name, (nothing, _) in _LACKING.items() if left.get(name) == nothing]
    for name in lacking:
        del left[name]
    low, high = left.get("highest_control", (0.0, 0.0))
    if left.get("lowest_control") == (-high, -low):
        left["control_limit"] = left.pop("highest_control")
        del left["lowest_control"]
    for feature, words, unit in _WORDS:
        forward, backward = (left.pop(feature.format(way), None) for way in _WAYS)
        is_one = forward == backward or "{}" not in feature
        ways = (("", forward),) if is_one else ((" forward", forward), (" backward", backward))
        for way, bounds in ways:
            if bounds:
                yield words.format(in_words(bounds, unit)) + way
    yield from (f"{name} {in_words(bounds)}" for name, bounds in left.items())
    if all(
        _is_same_number(*(ranges.get(each.format(way)) for way in _WAYS)) for each in _FRICTIONS
    ):
        yield "the same both ways"
    if lacking:
        *others, last = (_LACKING[name][1] for name in lacking)
        yield f"without {', '.join(others)}{' or ' if others else ''}{last}"


def _is_same_number(forward: Bounds | None, backward: Bounds | None) -> bool:
    return forward is not None and forward == backward and forward[0] == forward[1]
