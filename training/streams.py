"""Random generators by purpose: a step needs nothing from the draws of those before it."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What a random generator is for."""

    TRAINING_DATA = 0
    VALIDATION_DATA = 1
    WEIGHTS = 2
    SHUFFLE = 3
    STEP = 4
    VALIDATION = 5


def generator(seed: int, stream: Stream, index: int = 0) -> np.random.Generator:
    """Return the generator number `index` of a stream."""
    return np.random.default_rng([seed, stream, index])
