"""Who may come in: bounded by cost, and by whether everybody will still be in time."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Literal, NamedTuple, TypeAlias

from app.api.forecast import finish_times, queue_times
from app.api.rates import Rates
from app.inference.job import Job
from app.inference.model_store import Model
from app.settings import Settings

MARGIN = 1.25
"""A forecast may be this much too short."""
MARGIN_SECONDS = 0.01
"""And by this much: threads wake up, an answer is written."""

SHORT_SECONDS = 0.05
"""A compiled plan that takes no longer waits for none that does."""

NONE = "none"
"""In the place of a model's name where there is none."""
Lane: TypeAlias = Literal["network", "short", "long"]
"""Where a plan waits its turn: for the network, or for a core among plans of its own kind."""
Reason: TypeAlias = Literal["queue_full", "deadline"]


class Refused(Exception):
    """The request was not taken on; nothing was done for it."""

    def __init__(self, reason: Reason, detail: str, retry_after_s: float) -> None:
        super().__init__(detail)
        self.reason = reason
        self.retry_after_s = max(1, math.ceil(retry_after_s))


@dataclass(eq=False, slots=True)
class Work:
    """What a request takes, as far as it is known when it arrives."""

    job: Job
    """Its rows through the network."""
    model: Model | None
    """None where there are no such rows."""
    rows_per_step: int
    """Rows of its job that can go through the network at once."""
    rollout_steps: int
    """Simulated time steps, over all targets."""
    kind: str
    """Plans of a kind take about as long for a time step."""


@dataclass(eq=False, slots=True)
class _Admitted:
    work: Work
    lane: Lane


class Pending(NamedTuple):
    """What is at work or waiting."""

    requests: int
    rows: int
    """That still have to go through the network."""


class Admission:
    """Keeps count of what was taken on, and forecasts when it will be done.

    Args:
        settings: the bounds.
        rates: how fast work gets done.
        compiled_at_once: how many compiled plans are worked on at once, in each lane.
    """

    def __init__(self, settings: Settings, rates: Rates, compiled_at_once: int) -> None:
        self._settings = settings
        self._rates = rates
        self._compiled_at_once = compiled_at_once
        self._admitted: dict[Work, _Admitted] = {}

    def __len__(self) -> int:
        return len(self._admitted)

    @property
    def jobs(self) -> list[Job]:
        """The jobs of all that was taken on and is not done."""
        return [work.job for work in self._admitted]

    @property
    def pending(self) -> dict[str, Pending]:
        """What was taken on and is not done, by model."""
        by_model: dict[str, Pending] = {}
        for work in self._admitted:
            label = work.model.label if work.model else NONE
            requests, rows = by_model.get(label, (0, 0))
            by_model[label] = Pending(requests + 1, rows + work.job.rows_left)
        return by_model

    @contextmanager
    def admitted(self, work: Work) -> Iterator[Lane]:
        """Take on `work` until the context ends, and say in which lane it goes.

        Raises:
            Refused: there is too much to do already, or it or another one would miss its deadline.
        """
        entry = _Admitted(work, self._lane(work))
        self._check_cost(work)
        self._check_deadlines(entry)
        self._admitted[work] = entry
        try:
            yield entry.lane
        finally:
            del self._admitted[work]

    def _lane(self, work: Work) -> Lane:
        if work.model:
            return "network"
        return "short" if self._computing_seconds(work) <= SHORT_SECONDS else "long"

    def _computing_seconds(self, work: Work) -> float:
        return self._rates.seconds_of_steps(work.kind, work.rollout_steps)

    def _check_cost(self, work: Work) -> None:
        settings = self._settings
        for what, value, limit in (
            ("requests", len(self._admitted) + 1, settings.max_pending),
            (
                "rows through the network",
                sum(job.rows_left for job in self.jobs) + work.job.rows_left,
                settings.max_pending_rows,
            ),
            (
                "simulated time steps",
                sum(other.rollout_steps for other in self._admitted) + work.rollout_steps,
                settings.max_pending_rollout_steps,
            ),
        ):
            if value > limit:
                raise Refused("queue_full", f"with this one, {value} {what} would be pending", 1.0)

    def _check_deadlines(self, new: _Admitted) -> None:
        """Refuse `new` if it would be late, or would hold up another one that must not be."""
        now = perf_counter()
        others = [entry for entry in self._admitted.values() if entry.lane == new.lane]
        with_new = self._forecast([*others, new])
        late = _lateness(new, with_new[new], now)
        if late > 0:
            left = new.work.job.deadline - now
            raise Refused(
                "deadline",
                f"it would take about {left + late:.2g} s, and its deadline is in {left:.2g} s",
                late,
            )
        if all(_lateness(other, with_new[other], now) <= 0 for other in others):
            return
        without_new = self._forecast(others)
        for other in others:
            late = _lateness(other, with_new[other], now)
            is_held_up = with_new[other] > without_new[other]
            if late > 0 and is_held_up and other.work.job.deadline > now:
                raise Refused("deadline", "another request would miss its deadline", late)

    def _forecast(self, entries: list[_Admitted]) -> dict[_Admitted, float]:
        """Return in how many seconds each is done; all are of one lane."""
        if entries and entries[0].lane == "network":
            entries = sorted(entries, key=lambda entry: entry.work.job.urgency)
        return dict(zip(entries, self._finish(entries), strict=True))

    def _finish(self, entries: list[_Admitted]) -> list[float]:
        """Return in how many seconds each is done, in the order in which their turn comes."""
        computing = [self._computing_seconds(entry.work) for entry in entries]
        models = [entry.work.model for entry in entries]
        if None in models:
            return queue_times(computing, self._compiled_at_once)
        sampling, at_least = [], []
        for entry, model in zip(entries, models, strict=True):
            assert model is not None
            seconds = self._rates.seconds_of_rows(model, entry.work.job.rows_left)
            sampling.append(seconds)
            # Beside others, a step takes a whole tick, however few rows of it are its own.
            crowding = model.pace.rows_at_once / entry.work.rows_per_step
            at_least.append(seconds * (max(1.0, crowding) if len(entries) > 1 else 1.0))
        return [
            max(finish, least) + own
            for finish, least, own in zip(finish_times(sampling), at_least, computing, strict=True)
        ]


def _lateness(entry: _Admitted, seconds: float, now: float) -> float:
    """Return by how many seconds it may miss its deadline if it takes `seconds` more."""
    return now + MARGIN * seconds + MARGIN_SECONDS - entry.work.job.deadline
