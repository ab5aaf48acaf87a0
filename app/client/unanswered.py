"""The problems of a batch that have no line yet: what is asked for, again where a connection broke.

Nothing here sends; the clients do, waiting or not.
"""

import secrets
from collections.abc import Iterator
from time import monotonic
from typing import Any

import httpx
from pydantic import ConfigDict, TypeAdapter

from app.wire.batches import (
    BatchFailure,
    BatchLine,
    BatchPlan,
    BatchProblem,
    PlanBatchRequest,
    problem_seed,
)
from app.wire.requests import MAX_SEED

LINE: TypeAdapter[BatchPlan | BatchFailure] = TypeAdapter(
    BatchLine, config=ConfigDict(defer_build=True)
)
BROKEN = (httpx.NetworkError, httpx.RemoteProtocolError)
"""What may happen to a connection in the middle of an answer."""


class Unanswered:
    """What is left of a batch.

    Every problem is sent with the seed that it has in the whole batch: its plan is the same,
    whenever and beside whichever others it is asked for.

    Args:
        request: the batch.
        patience_s: how long to go on without a line.
    """

    def __init__(self, request: PlanBatchRequest, patience_s: float) -> None:
        seed = secrets.randbelow(MAX_SEED + 1) if request.seed is None else request.seed
        self._shared = request.model_dump(exclude={"problems"}) | {"seed": seed}
        self._left = {
            index: _with_seed(problem, problem_seed(seed, index))
            for index, problem in enumerate(request.problems)
        }
        self._asked: list[int] = []
        self._text = bytearray()
        self._patience_s = patience_s
        self._last_line = monotonic()

    def __bool__(self) -> bool:
        return bool(self._left)

    def body(self) -> dict[str, Any]:
        """Return the request for all that is left."""
        self._asked, self._text = list(self._left), bytearray()
        return self._shared | {"problems": list(self._left.values())}

    def read(self, data: bytes) -> Iterator[BatchPlan | BatchFailure]:
        """Take bytes of the answer; yield what each line that is whole says.

        With the problem's index in the whole batch.
        """
        self._text += data
        *lines, rest = self._text.split(b"\n")
        self._text = rest
        for line in lines:
            answer = LINE.validate_json(line)
            answer.index = self._asked[answer.index]
            del self._left[answer.index]
            self._last_line = monotonic()
            yield answer

    def ended(self, error: httpx.TransportError | None = None) -> None:
        """Return if it is all here, or what is left may be asked for again.

        Args:
            error: why the answer ended before its end, if it did.

        Raises:
            httpx.TransportError: it has ended early for too long.
        """
        if self._left and monotonic() - self._last_line > self._patience_s:
            raise error or httpx.RemoteProtocolError("the answer ended before its last line")


def _with_seed(problem: BatchProblem, seed: int) -> dict[str, Any]:
    written = problem.model_dump(exclude_none=True)
    return {"seed": seed} | written
