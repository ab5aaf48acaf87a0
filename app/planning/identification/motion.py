"""What a machine does in a log: how long it moves and rests, how fast, and what sets it off."""

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from app.planning.identification.log import Log
from app.planning.identification.prediction import Trace

LIKELY = 0.5
REST_MEASUREMENTS = 3
"""A mass that rests for fewer passes through zero."""


@dataclass(frozen=True, slots=True)
class Motion:
    """What there was to see."""

    LEAST_STEPS: ClassVar[int] = 8
    FEW_STEPS: ClassVar[int] = 30
    """Fewer steps in motion say nothing for certain."""

    moving_steps: int
    longest_rest: int
    """Steps."""
    set_off: tuple[int, int]
    """How often it broke away from rest, forward and backward."""
    moved: tuple[bool, bool]
    """Whether it moved forward and backward for a while."""
    slow: float
    """m/s: one in ten speeds in motion is lower."""
    fast: float
    """m/s: nine in ten are lower."""

    @classmethod
    def of(cls, trace: Trace, log: Log, stride: int) -> "Motion":
        """Return what the filter saw."""
        rests = trace.rest > LIKELY
        moving = ~rests
        speeds = np.abs(trace.velocities[moving])
        least = REST_MEASUREMENTS * stride
        edges = np.flatnonzero(np.diff(rests.astype(np.int8))) + 1
        spells = list(pairwise([0, *edges.tolist(), rests.size]))
        longest, set_off = 0, [0, 0]
        for (begin, end), (_, after) in zip(spells, [*spells[1:], (0, 0)], strict=True):
            if not rests[begin]:
                continue
            longest = max(longest, end - begin)
            if end - begin >= least and after - end >= REST_MEASUREMENTS:
                forward = log.positions[after] > log.positions[end]
                set_off[0 if forward else 1] += 1
        along = (trace.velocities > 0.0) & moving, (trace.velocities < 0.0) & moving
        slow, fast = np.quantile(speeds, (0.1, 0.9)) if speeds.size else (0.0, 0.0)
        return cls(
            int(moving.sum()),
            longest,
            (set_off[0], set_off[1]),
            (int(along[0].sum()) >= cls.LEAST_STEPS, int(along[1].sum()) >= cls.LEAST_STEPS),
            float(slow),
            float(fast),
        )
