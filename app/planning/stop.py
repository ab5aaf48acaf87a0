"""Ending a plan early: whoever asked for it has gone, or its time is up."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Flag: TypeAlias = NDArray[np.uint8]
"""(1,): not zero once the plan is to stop."""


class Stopped(Exception):
    """The plan is not wanted any more."""


class Stop:
    """Whether a plan is still wanted; asked and told from any thread.

    Kernels, which know no exceptions, look at `flag` between two of their iterations and return
    early; whoever called them calls `check` afterwards.
    """

    def __init__(self) -> None:
        self.flag: Flag = np.zeros(1, dtype=np.uint8)
        self._reason: Stopped | None = None

    def set(self, reason: Stopped) -> None:
        """Stop at the next check, with `reason`; the first reason stands."""
        if self._reason is None:
            self._reason = reason
            self.flag[0] = 1

    def check(self) -> None:
        """Return if the plan is still wanted.

        Raises:
            Stopped: it is not; the reason that was given.
        """
        if self._reason is not None:
            raise self._reason


NEVER = Stop()
"""For plans that nobody stops."""
