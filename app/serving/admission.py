"""Who may come in: bounded by cost, and by whether everybody will still be in time."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Literal, NamedTuple, TypeAlias

from app.inference.job import Job
from app.inference.model_card import ModelCard
from app.serving.forecast import finish_times, queue_times, turn_times
from app.serving.rates import Rates
from app.serving.refusals import Refused
from app.settings import Settings

MARGIN = 1.75
"""A forecast may be this much too short."""
MARGIN_SECONDS = 0.01
"""And by this much for each request that is pending: they take turns in Python's interpreter."""

SHORT_SECONDS = 0.05
"""A compiled plan that takes no longer waits for none that does."""

WRITING_SECONDS = 2e-8
"""To write and compress a byte of an answer."""

NONE = "none"
"""In the place of a model's name where there is none."""
Lane: TypeAlias = Literal["network", "short", "long", "batch"]
"""Where a plan waits its turn: for the network, or for a core among plans of its own kind. Parts of
a batch wait among the long ones, each for its own turn."""


@dataclass(eq=False, slots=True, kw_only=True)
class Work(Job):
    """A job with all that it takes, as far as that is known when it arrives."""

    model: ModelCard | None
    """None where nothing goes through a network."""
    rows_per_step: int
    """Rows that can go through the network at once."""
    rollout_steps: int
    """Simulated time steps, over all targets."""
    kind: str
    """Plans of a kind take about as long for a time step."""
    answer_bytes: int
    """As many as are expected; as many as there are once the answer is made. Of a batch, those that
    may be made and not sent."""
    is_batch: bool = False
    """Whether it is done in parts, and the others come first."""
    is_held_up: bool = False
    """Whether its own client keeps it from being done: nobody else has to wait for it then."""


class Pending(NamedTuple):
    """What is at work or waiting, and its answers, until they are sent."""

    requests: int
    rows: int
    """That still have to go through the network."""
    answer_bytes: int = 0


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
        self._admitted: dict[Work, Lane] = {}
        self._answering: set[Work] = set()

    def __len__(self) -> int:
        return len(self._admitted)

    @property
    def scale(self) -> int:
        """How many times the bounds are allowed."""
        return 1

    @property
    def works(self) -> list[Work]:
        """All that was taken on and is not done."""
        return list(self._admitted)

    @property
    def pending(self) -> dict[str, Pending]:
        """What was taken on and is not done, or not sent, by model."""
        by_model: dict[str, Pending] = {}
        for work in self._admitted:
            label = _label(work.model)
            requests, rows, _ = by_model.get(label, Pending(0, 0))
            by_model[label] = Pending(requests + 1, rows + work.rows_left)
        for work in self._answering:
            label = _label(work.model)
            requests, rows, answer_bytes = by_model.get(label, Pending(0, 0))
            by_model[label] = Pending(requests, rows, answer_bytes + work.answer_bytes)
        return by_model

    @property
    def queued(self) -> dict[Lane, float]:
        """Seconds until all in each lane is done that was taken on; of those with something."""
        seconds: dict[Lane, float] = {}
        for work, lane in self._admitted.items():
            computing = self._computing_seconds(work) / self._compiled_at_once
            if work.model:
                computing += self._rates.seconds_of_rows(
                    work.model, work.rows_left, is_crowded=False
                )
            seconds[lane] = seconds.get(lane, 0.0) + computing
        return seconds

    @contextmanager
    def answering(self, work: Work) -> Iterator[None]:
        """Keep count of the work's answer until the context ends, which is when it is sent.

        Raises:
            Refused: there are too many bytes already that clients have not taken.
        """
        total = sum(other.answer_bytes for other in self._answering) + work.answer_bytes
        if total > self._settings.max_pending_answer_bytes:
            raise _queue_full(total, "bytes of answers")
        self._answering.add(work)
        try:
            yield
        finally:
            self._answering.remove(work)

    @contextmanager
    def admitted(self, work: Work) -> Iterator[Lane]:
        """Take on `work` until the context ends, and say in which lane it goes.

        Raises:
            Refused: there is too much to do already, or it or another one would miss its deadline.
        """
        self._check_cost(work)
        self._check_deadlines(work, self._lane(work))
        with self.taken_on(work) as lane:
            yield lane

    @contextmanager
    def taken_on(self, work: Work) -> Iterator[Lane]:
        """Do as `admitted` does, and ask nothing: whoever hands it on has."""
        lane = self._admitted[work] = self._lane(work)
        try:
            yield lane
        finally:
            del self._admitted[work]

    def _lane(self, work: Work) -> Lane:
        if work.model:
            return "network"
        if work.is_batch:
            return "batch"
        return "short" if self._computing_seconds(work) <= SHORT_SECONDS else "long"

    def _computing_seconds(self, work: Work) -> float:
        simulating = self._rates.seconds_of_steps(work.kind, work.rollout_steps)
        return simulating + WRITING_SECONDS * work.answer_bytes

    def _check_cost(self, work: Work) -> None:
        settings = self._settings
        for what, value, limit in (
            ("requests", len(self._admitted) + 1, settings.max_pending),
            (
                "rows through the network",
                sum(other.rows_left for other in self._admitted) + work.rows_left,
                settings.max_pending_rows,
            ),
            (
                "simulated time steps",
                sum(other.rollout_steps for other in self._admitted) + work.rollout_steps,
                settings.max_pending_rollout_steps,
            ),
        ):
            if value > limit * self.scale:
                raise _queue_full(value, what)

    def _check_deadlines(self, new: Work, lane: Lane) -> None:
        """Refuse `new` if it would be late, or would hold up another one that must not be."""
        now = perf_counter()
        after = self._forecast({**self._admitted, new: lane})

        def lateness(work: Work) -> float:
            """Return by how many seconds it may miss its deadline."""
            due = now + MARGIN * after[work] + MARGIN_SECONDS * len(after)
            return due - work.deadline

        late = lateness(new)
        if late > 0:
            left = new.deadline - now
            raise Refused(
                "deadline",
                f"it would take about {left + late:.2g} s, and its deadline is in {left:.2g} s",
                late,
            )
        in_danger = [
            other
            for other in self._admitted
            if other.deadline > now and not other.is_held_up and lateness(other) > 0
        ]
        before = self._forecast(self._admitted) if in_danger else {}
        for other in in_danger:
            if after[other] > before[other]:
                detail = "another request would miss its deadline"
                raise Refused("deadline", detail, lateness(other))

    def _forecast(self, admitted: dict[Work, Lane]) -> dict[Work, float]:
        """Return in how many seconds each is done."""
        lanes: dict[Lane, list[Work]] = {"network": [], "short": [], "long": [], "batch": []}
        for work, lane in admitted.items():
            lanes[lane].append(work)
        lanes["network"].sort(key=lambda work: work.urgency)
        return {
            **self._sampled(lanes["network"], is_crowded=bool(lanes["long"] or lanes["batch"])),
            **self._computed(lanes["short"]),
            **self._computed(lanes["long"]),
            **self._computed_in_turns(lanes["batch"], lanes["long"]),
        }

    def _computed(self, works: list[Work]) -> dict[Work, float]:
        seconds = [self._computing_seconds(work) for work in works]
        return dict(zip(works, queue_times(seconds, self._compiled_at_once), strict=True))

    def _computed_in_turns(self, batches: list[Work], first: list[Work]) -> dict[Work, float]:
        seconds = [self._computing_seconds(work) for work in batches]
        others = [self._computing_seconds(work) for work in first]
        finished = turn_times(seconds, others, self._compiled_at_once)
        return dict(zip(batches, finished, strict=True))

    def _sampled(self, works: list[Work], is_crowded: bool) -> dict[Work, float]:
        sampling, crowded_out = [], []
        for work in works:
            assert work.model is not None
            seconds = self._rates.seconds_of_rows(work.model, work.rows_left, is_crowded=is_crowded)
            sampling.append(seconds)
            # Beside others, a step takes a whole tick, however few rows of it are its own.
            ticks_of_a_row = max(1.0, work.model.pace.rows_at_once / work.rows_per_step)
            crowded_out.append(seconds * (ticks_of_a_row - 1.0) if len(works) > 1 else 0.0)
        finished = zip(works, finish_times(sampling), crowded_out, strict=True)
        return {
            work: finish + waiting + self._computing_seconds(work)
            for work, finish, waiting in finished
        }


def _label(model: ModelCard | None) -> str:
    return model.label if model else NONE


def _queue_full(value: int, what: str) -> Refused:
    return Refused("queue_full", f"with this one, {value} {what} would be pending", 1.0)
