"""Where a few fixed control sequences end: what a plant makes of full control, and of none.

A model that is told how far they miss the target need not learn friction, damping and bias anew: it
learns what to blend of them.
"""

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.natural_units import natural_units
from app.planning.plant.rollout import rollout_on
from app.planning.plant.system import Plant
from app.planning.plant.task import Task

_HALVES = {
    "coasting": (0.0, 0.0),
    "forward": (1.0, 1.0),
    "backward": (-1.0, -1.0),
    "forth_and_back": (1.0, -1.0),
    "back_and_forth": (-1.0, 1.0),
}
"""No control, full control either way, and full control that turns round halfway."""
PROBES = tuple(_HALVES)


def probe_controls(name: str, horizon: int) -> FloatArray:
    """Return the controls (H,) of a probe, in natural units."""
    return np.where(np.arange(horizon) < horizon // 2, *_HALVES[name])


def probe_misses(task: Task, horizon: int) -> FloatArray:
    """Return where the probes end less where they should, (N, 5, 2) in m and m/s.

    Args:
        task: the fields of it and of its plant are floats or (N,).
        horizon: H.
    """
    probes = np.stack([probe_controls(name, horizon) for name in PROBES])
    fields = (np.atleast_1d(field) for field in (*task[:-1], *task.plant))
    rows = np.column_stack(np.broadcast_arrays(*fields))
    misses = np.empty((len(rows), len(PROBES), 2))
    for row, miss in zip(rows.tolist(), misses, strict=True):
        plant = Plant(*row[4:])
        units = natural_units(plant)
        states = rollout_on(plant, np.array(row[:2]), units.middle + units.control * probes)
        np.subtract(states[:, -1], row[2:4], out=miss)
    return misses
