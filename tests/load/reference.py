"""What the idle server answers, to compare with when it is not idle."""

from enum import Enum, auto
from typing import Any

import numpy as np

from tests.load.client import Answer, ServiceClient
from tests.load.scenario import Question, question
from tests.load.store import RELOADED, weights_of

TOLERANCE = 1e-4
"""m/s^2."""
SHARE_RELOADED = 3
"""One in so many of the questions that need the network is asked of the model that changes."""


class Likeness(Enum):
    """How an answer compares with the one of the idle server."""

    SAME = auto()
    """Bit by bit, candidates, ranking and measures included."""
    CLOSE = auto()
    """Other bits; its controls are within `TOLERANCE`."""
    DIFFERENT = auto()


class Pool:
    """Questions whose answers are known.

    Args:
        seed: of the mix.
        size: how many questions.
        longest: s; those of the mix that take longer are left out.
    """

    def __init__(self, seed: int, size: int, longest: float) -> None:
        mix = (question(seed, index) for index in range(20 * size))
        self.questions = [asked for asked in mix if asked.seconds <= longest][:size]
        for asked in self.questions[::SHARE_RELOADED]:
            if asked.rows:
                asked.body["model"] = RELOADED
        self._known: dict[tuple[int, int], Any] = {}

    async def ask_all(self, service: ServiceClient, version: int) -> int:
        """Ask every question alone whose answer with this version is not known, twice.

        Returns:
            How many were not answered, or not the same both times.
        """
        unlike = 0
        for index, asked in enumerate(self.questions):
            key = index, weights_of(version) if _changes(asked) else 0
            if key in self._known:
                continue
            first, second = [await service.ask(asked.route, asked.body) for _ in range(2)]
            self._known[key] = _lasting(first.body)
            unlike += first.status != 200 or _lasting(second.body) != self._known[key]
        return unlike

    def compare(self, index: int, answer: Answer) -> Likeness:
        """Say whether a plan is the one that the idle server made."""
        changes = _changes(self.questions[index])
        weights = weights_of(int(answer.body["model"]["version"])) if changes else 0
        known = self._known[index, weights]
        found = _lasting(answer.body)
        if found == known:
            return Likeness.SAME
        ours, theirs = np.array(found["controls"]), np.array(known["controls"])
        if ours.shape == theirs.shape and np.abs(ours - theirs).max() <= TOLERANCE:
            return Likeness.CLOSE
        return Likeness.DIFFERENT


def _changes(asked: Question) -> bool:
    return asked.body.get("model") == RELOADED


def _lasting(body: Any) -> Any:
    """Return an answer without what differs from time to time."""
    if isinstance(body, dict):
        differs = ("timing_ms", "version", "sha256")
        return {key: _lasting(value) for key, value in body.items() if key not in differs}
    if isinstance(body, list) and body and isinstance(body[0], dict):
        return [_lasting(value) for value in body]
    return body
