"""A batch: what its problems share is settled once, and then they are planned a few together.

Plain blocking code, like service.py: a line for each problem, and one at fault is one bad line.
"""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter, sleep
from typing import Any

from pydantic import ValidationError

from app.inference.model_store import UnfitModel
from app.planning.methods import WarmStarted
from app.planning.stop import Stopped
from app.serving.admission import Work
from app.serving.batch_parts import size_of_part
from app.serving.json_parts import PART_BYTES, PAUSE_SECONDS, json_parts
from app.serving.rates import Rates
from app.serving.refusals import DeadlineExceeded, InvalidField, InvalidFields
from app.serving.service import PlanningService, ResolvedRequest
from app.wire.batches import BatchProblem, PlanBatchRequest, problem_seed
from app.wire.field_errors import field_errors
from app.wire.problems import FieldError, ProblemDetails
from app.wire.requests import PlanRequest

INTERNAL_ERROR = 500
Describe = Callable[[Exception], ProblemDetails]
"""How an error is told."""

log = logging.getLogger(__name__)


@dataclass(slots=True)
class Batch:
    """A batch with nothing left open."""

    request: PlanBatchRequest
    stand_in: ResolvedRequest[PlanRequest]
    """One of its problems, for what all of them take."""
    work: Work
    """Of all problems that are not done."""
    parts_at_once: int
    is_stand_in_shared: bool
    """Whether its plant is that of every problem which names none."""
    first: int
    """The index of its first problem in a larger batch, of which this is a part."""
    _service: PlanningService
    _rates: Rates

    @property
    def log_fields(self) -> dict[str, Any]:
        """What the service's log tells of it."""
        return self.stand_in.log_fields | {"num_problems": len(self.request.problems)}

    @property
    def seed(self) -> int:
        """The batch's own, drawn if the request has none."""
        return self.stand_in.seed

    def parts(self) -> Iterator[range]:
        """Cut the problems that are left into parts, as long as is right when each is begun."""
        first, count = 0, len(self.request.problems)
        while first < count:
            size = min(self._size_of_part(), count - first)
            yield range(first, first + size)
            first += size

    def _size_of_part(self) -> int:
        return size_of_part(self.stand_in.work, self.work.kind, self._rates)

    def answer(self, part: range, waited_ms: float, describe: Describe) -> list[bytes]:
        """Plan for some of the problems, and write a line of JSON for each.

        Args:
            part: their indices.
            waited_ms: how long they waited for their turn.
            describe: says how an error is told.

        Returns:
            The lines, in pieces of `PART_BYTES` and a little more.

        Raises:
            Stopped: nobody wants them any more. Past the deadline each has a line that says so.
        """
        begun = perf_counter()
        lines: list[dict[str, Any]] = []
        resolved: dict[int, ResolvedRequest[PlanRequest]] = {}
        for index in part:
            try:
                resolved[index] = self._resolve(index)
            except Exception as error:
                lines.append(self._failure(index, error, describe))
        network_ms = 0.0
        for run in _runs(resolved):
            share = waited_ms * len(run) / len(part)
            for line, own_network_ms in self._plan(run, share, describe):
                lines.append(line)
                network_ms += own_network_ms
        text = list(self._write(lines))
        self._measure(perf_counter() - begun - network_ms / 1e3, len(resolved))
        return text

    def done(self, part: range) -> None:
        """Take what a part took from what is left; for the thread that the admission is in."""
        self.work.rollout_steps -= self.stand_in.work.rollout_steps * len(part)

    def _resolve(self, index: int) -> ResolvedRequest[PlanRequest]:
        """Settle one problem.

        Raises:
            InvalidFields, InvalidField, UnfitModel: it is at fault.
        """
        written: Any = self.request.problems[index]
        place = f"/problems/{self.first + index}"
        try:
            problem = BatchProblem.model_validate(written)
        except ValidationError as error:
            found = field_errors(error.errors(), written)
            raise InvalidFields(
                [FieldError(pointer=place + own.pointer, detail=own.detail) for own in found]
            ) from None
        seed = problem_seed(self.seed, self.first + index) if problem.seed is None else problem.seed
        own = {
            "initial_state": problem.initial_state,
            "target_state": problem.target_state,
            "seed": seed,
        }
        if problem.system is None and self.is_stand_in_shared and not self.request.uncertainty:
            request = self.stand_in.request.model_copy(update=own)
            return replace(self.stand_in, request=request, seed=seed, work=self.work)
        own["system"] = problem.system or self.request.system
        try:
            request = self.stand_in.request.model_copy(update=own)
            return replace(self._service.resolve(request), work=self.work)
        except UnfitModel as error:
            raise InvalidField(f"{place if problem.system else ''}/system", str(error)) from None

    def _plan(
        self,
        run: dict[int, ResolvedRequest[PlanRequest]],
        waited_ms: float,
        describe: Describe,
    ) -> Iterator[tuple[dict[str, Any], float]]:
        """Plan for problems together, or each alone if that fails: a failure is its problem's.

        Yields:
            A line's fields, and the milliseconds that its plan spent in the network.
        """
        try:
            answers = self._service.answer_many(list(run.values()), waited_ms)
        except Exception as error:
            if isinstance(error, Stopped) and not isinstance(error, DeadlineExceeded):
                raise
            if len(run) > 1:
                for index, resolved in run.items():
                    yield from self._plan({index: resolved}, waited_ms / len(run), describe)
            else:
                [index] = run
                yield self._failure(index, error, describe), 0.0
            return
        for (index, resolved), (answer, timing) in zip(run.items(), answers, strict=True):
            in_network = timing.queue + timing.propose if resolved.model else 0.0
            yield {"index": self.first + index} | answer, in_network

    def _failure(self, index: int, error: Exception, describe: Describe) -> dict[str, Any]:
        problem = describe(error)
        if problem.status == INTERNAL_ERROR:
            log.warning("problem %d of a batch failed", index, exc_info=error)
        return {"index": self.first + index, "problem": problem.model_dump(exclude_none=True)}

    def _write(self, lines: list[dict[str, Any]]) -> Iterator[bytes]:
        text = bytearray()
        for line in lines:
            for piece in json_parts(line):
                text += piece
                if len(text) >= PART_BYTES:
                    yield bytes(text)
                    text.clear()
                    self.work.stop.check()
                    sleep(PAUSE_SECONDS)
            text += b"\n"
        yield bytes(text)

    def _measure(self, seconds: float, count: int) -> None:
        """Count what a part took beside the network, Python and writing included."""
        if count and not (self.work.model and isinstance(self.stand_in.recipe.method, WarmStarted)):
            steps = self.stand_in.work.rollout_steps * count
            self._rates.add_steps(self.work.kind, seconds, steps)


def _runs(
    resolved: dict[int, ResolvedRequest[PlanRequest]],
) -> Iterator[dict[int, ResolvedRequest[PlanRequest]]]:
    """Put those together that follow each other and can be planned for together."""
    run: dict[int, ResolvedRequest[PlanRequest]] = {}
    before: ResolvedRequest[PlanRequest] | None = None
    for index, own in resolved.items():
        if before is not None and not _go_together(before, own):
            yield run
            run = {}
        run[index] = own
        before = own
    if run:
        yield run


def _go_together(one: ResolvedRequest[PlanRequest], other: ResolvedRequest[PlanRequest]) -> bool:
    if one.recipe is other.recipe and one.system is other.system:
        return True
    if one.recipe.uncertainty or other.recipe.uncertainty:  # each has drawn its own plants
        return False
    return (one.model, one.horizon, one.system) == (
        other.model,
        other.horizon,
        other.system,
    ) and one.recipe == other.recipe
