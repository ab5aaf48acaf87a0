"""How many problems of a batch are planned together."""

import math

from app.serving.admission import Work
from app.serving.rates import Rates

PART_SECONDS = 0.01
"""A part of a batch takes about so long: then it is the turn of others."""
MOST_TOGETHER = 32
"""More problems in a part make them no faster."""
TICKS_OF_A_PART = 4
"""So many full ticks of the engine are a step of a part's rows: it has some while others wait."""
MOST_PART_BYTES = 1 << 18
"""Of the answers that a part makes, unless one of them has more."""


def size_of_part(one: Work, kind: str, rates: Rates) -> int:
    """Return how many problems, each of which takes as much as `one`, are planned together."""
    if one.model:
        rows = TICKS_OF_A_PART * one.model.pace.rows_at_once
        right = math.ceil(rows / one.rows_per_step)
    else:
        right = int(PART_SECONDS / max(rates.seconds_of_steps(kind, one.rollout_steps), 1e-9))
    most = MOST_PART_BYTES // max(one.answer_bytes, 1)
    return max(1, min(right, most, MOST_TOGETHER))
