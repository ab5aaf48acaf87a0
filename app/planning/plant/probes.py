"""Where a few fixed control sequences end: what a plant makes of full control, and of none.

A model that is told how far they miss the target need not learn friction, damping and bias anew: it
learns what to blend of them.
"""

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.natural_units import natural_units
from app.planning.plant.rollout import terminal_state
from app.planning.plant.system import Plant
from app.planning.plant.task import Task

PROBES = ("coasting", "forward", "backward", "forth_and_back", "back_and_forth")
"""No control, full control either way, and full control that turns round halfway."""


def probe_controls(name: str, horizon: int) -> FloatArray:
    """Return the controls (H,) of a probe, in natural units."""
    first, second = {
        "coasting": (0.0, 0.0),
        "forward": (1.0, 1.0),
        "backward": (-1.0, -1.0),
        "forth_and_back": (1.0, -1.0),
        "back_and_forth": (-1.0, 1.0),
    }[name]
    return np.where(np.arange(horizon) < horizon // 2, first, second)


def probe_misses(name: str, task: Task, horizon: int) -> FloatArray:
    """Return where a probe ends less where it should, (N, 2) in m and m/s.

    Args:
        name: of `PROBES`.
        task: the fields of it and of its plant are floats or (N,).
        horizon: H.
    """
    controls = probe_controls(name, horizon)
    rows = np.column_stack(
        np.broadcast_arrays(*(np.atleast_1d(x) for x in (*task[:4], *task.plant)))
    )
    misses = np.empty((len(rows), 2))
    for row, miss in zip(rows.tolist(), misses, strict=True):
        position, velocity, target_position, target_velocity, *fields = row
        plant = Plant(*fields)
        units = natural_units(plant)
        own = units.middle + units.control * controls
        end_position, end_velocity = terminal_state(own, position, velocity, plant)
        miss[:] = end_position - target_position, end_velocity - target_velocity
    return misses
