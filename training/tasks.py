"""Many tasks at once, each for a machine of its own."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.planning.arrays import FloatArray, IntArray
from app.planning.plant.natural_units import Scales, scales
from app.planning.plant.spread import Spread
from app.planning.plant.system import ByDirection, Plant, System
from app.planning.plant.task import Task
from app.planning.problem import Problem

_BIAS = Plant._fields.index("bias")
_OPPOSITE = [
    Plant._fields.index(
        field.replace("forward", "backward")
        if "forward" in field
        else field.replace("backward", "forward")
    )
    for field in Plant._fields
]
"""The column of the same field in the other direction; the limits are alike both ways."""


@dataclass(frozen=True, slots=True)
class Tasks:
    """N tasks for plants with gain 1 and limits -1 and 1."""

    states: FloatArray
    """(N, 4): position and velocity of the start, and of the target."""
    plants: FloatArray
    """(N, 15), the fields of `Plant`."""
    spreads: FloatArray
    """(N, 4), the fields of `Spread`: by how much each plant may be off."""

    def __len__(self) -> int:
        return len(self.states)

    @property
    def columns(self) -> Task:
        """The same as a task whose fields, and whose plant's, are arrays (N,)."""
        columns: Any = (*self.states.T, Plant(*self.plants.T))
        return Task(*columns)

    @property
    def spread(self) -> Spread:
        """Their spreads as one whose fields are arrays (N,)."""
        return Spread(*self.spreads.T)

    def rows(self, rows: IntArray | slice) -> "Tasks":
        """Return some of them."""
        return Tasks(self.states[rows], self.plants[rows], self.spreads[rows])

    def scales(self, horizon: int) -> Scales:
        """Return the reach and the speed of each, (N,)."""
        return scales(self.columns.plant, horizon)

    def problem(self, index: int, horizon: int) -> Problem:
        """Return one of them."""
        start, target = np.split(self.states[index], 2)
        return Problem(start, target, system_of(Plant(*self.plants[index].tolist())), horizon)

    def with_targets(self, targets: FloatArray) -> "Tasks":
        """Return the same with other targets (N, 2)."""
        return replace(self, states=np.hstack([self.states[:, :2], targets]))

    def with_spreads(self, spreads: FloatArray) -> "Tasks":
        """Return the same with plants that may be off by other shares (N, 4)."""
        return replace(self, spreads=spreads)

    def mirrored(self) -> "Tasks":
        """Return what a mirror makes of them: each machine's forward is its backward."""
        plants = self.plants[:, _OPPOSITE]
        plants[:, _BIAS] *= -1
        return Tasks(-self.states, plants, self.spreads)

    def followed_by(self, others: "Tasks") -> "Tasks":
        """Return these and then the others."""
        return Tasks(
            np.concatenate([self.states, others.states]),
            np.concatenate([self.plants, others.plants]),
            np.concatenate([self.spreads, others.spreads]),
        )


def system_of(plant: Plant) -> System:
    """Return the system of a plant with gain 1 and limits -1 and 1."""
    return System(
        static_friction=ByDirection(plant.static_forward, plant.static_backward),
        coulomb_friction=ByDirection(plant.coulomb_forward, plant.coulomb_backward),
        viscous_damping=ByDirection(plant.damping_forward, plant.damping_backward),
        stribeck_velocity=plant.stribeck_velocity or None,
        bias=plant.bias,
        control_limit=1.0,
        time_step=plant.time_step,
        velocity_threshold=plant.velocity_threshold,
    )
