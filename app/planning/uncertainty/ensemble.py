"""Ensembles: several plants that may be the true one, each with the state that it is in.

What their errors make as one number is in risk.py, how plants are drawn in relative.py.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.metrics import terminal_error
from app.planning.plant.rollout import rollout_on, terminal_state
from app.planning.plant.system import Plant, System
from app.planning.plant.task import Task

NO_PLANTS = np.empty((0, len(Plant._fields)))
"""Of no ensemble, as the kernels take it."""


class Scenarios(NamedTuple):
    """A task on every plant of an ensemble, as the kernels take it."""

    plants: FloatArray
    """(S, parameters), the fields of `Plant` in their order."""
    states: FloatArray
    """(S, 2): where each plant is, m and m/s."""
    target_position: float
    target_velocity: float


@dataclass(frozen=True, slots=True)
class Ensemble:
    """S plants, any of which may be the true one; they differ in neither time step nor limits."""

    plants: FloatArray
    """(S, parameters), the fields of `Plant` in their order."""
    states: FloatArray
    """(S, 2): where each plant is, m and m/s."""

    @classmethod
    def of(cls, systems: Sequence[System], state: FloatArray) -> "Ensemble":
        """Return an ensemble of `systems`, all in the same `state` (2,)."""
        return cls.at(np.array([system.plant for system in systems], dtype=np.float64), state)

    @classmethod
    def at(cls, plants: FloatArray, state: FloatArray) -> "Ensemble":
        """Return an ensemble of `plants` (S, parameters), all in the same `state` (2,)."""
        return cls(plants, np.tile(np.asarray(state, dtype=np.float64), (len(plants), 1)))

    def __len__(self) -> int:
        """Return S."""
        return len(self.plants)

    def spread(self, count: int) -> "Ensemble":
        """Return `count` of the plants in even steps, or all, if they are fewer."""
        step = max(1, len(self) // count)
        return Ensemble(
            np.ascontiguousarray(self.plants[::step][:count]),
            np.ascontiguousarray(self.states[::step][:count]),
        )

    def joined(self, other: "Ensemble") -> "Ensemble":
        """Return the plants of both."""
        return Ensemble(
            np.concatenate([self.plants, other.plants]), np.concatenate([self.states, other.states])
        )

    def after(self, controls: FloatArray) -> "Ensemble":
        """Return the ensemble after `controls` (N,) have been carried out on each of its plants."""
        return replace(self, states=self.terminal_states(controls[np.newaxis])[0])

    def errors(self, controls: FloatArray, target_state: FloatArray) -> FloatArray:
        """Return the terminal errors ||x_H - x*|| of `controls` (K, H) on every plant: (K, S)."""
        return terminal_error(self.terminal_states(controls), target_state)

    def terminal_states(self, controls: FloatArray) -> FloatArray:
        """Return the states that `controls` (K, H) lead to on every plant: (K, S, 2)."""
        nowhere = self.scenarios(np.zeros(2))
        return _terminal_states(np.ascontiguousarray(controls, dtype=np.float64), nowhere)

    def trajectories(self, controls: FloatArray) -> FloatArray:
        """Return the states that `controls` (H,) lead through on every plant: (S, H+1, 2)."""
        plants = (Plant(*row.tolist()) for row in self.plants)
        each = [
            rollout_on(plant, state, controls[np.newaxis])[0]
            for plant, state in zip(plants, self.states, strict=True)
        ]
        return np.array(each)

    def scenarios(self, target_state: FloatArray) -> Scenarios:
        """Return the task of getting to `target_state` (2,) as the kernels take it."""
        position, velocity = target_state
        return Scenarios(self.plants, self.states, float(position), float(velocity))


@compiled
def scenario(scenarios: Scenarios, index: int) -> Task:
    """Return the task on one of the plants."""
    row = scenarios.plants[index]
    plant = Plant(
        row[0],
        row[1],
        row[2],
        row[3],
        row[4],
        row[5],
        row[6],
        row[7],
        row[8],
        row[9],
        row[10],
        row[11],
        row[12],
        row[13],
        row[14],
    )
    return Task(
        scenarios.states[index, 0],
        scenarios.states[index, 1],
        scenarios.target_position,
        scenarios.target_velocity,
        plant,
    )


@compiled
def _terminal_states(controls: FloatArray, scenarios: Scenarios) -> FloatArray:
    num_candidates, num_plants = len(controls), len(scenarios.plants)
    states = np.empty((num_candidates, num_plants, 2))
    for s in range(num_plants):
        task = scenario(scenarios, s)
        for i in range(num_candidates):
            p, v = terminal_state(controls[i], task.position, task.velocity, task.plant)
            states[i, s, 0], states[i, s, 1] = p, v
    return states
