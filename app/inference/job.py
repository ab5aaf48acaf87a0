"""What the engine has to know of a request: how much is left of it, and whether it is wanted."""

from dataclasses import dataclass, field
from math import inf
from time import perf_counter

from app.planning.stop import Stop


@dataclass(eq=False, slots=True)
class Job:
    """One request's work for the network: a sampling, or one after the other for many targets."""

    rows_left: int
    """Rows that are still to go through the network, in all samplings."""
    deadline: float = inf
    """When it has to be done, by `perf_counter`."""
    stop: Stop = field(default_factory=Stop)
    arrived: float = field(default_factory=perf_counter)
    """When the request came, by `perf_counter`."""

    @property
    def urgency(self) -> tuple[float, float]:
        """Sorts jobs: the nearest deadline first, of equal ones the oldest."""
        return self.deadline, self.arrived
