"""Why a request is not answered: what the service refuses, and what ends it early."""

import math
from typing import Literal, TypeAlias

from app.planning.stop import Stopped
from app.wire.problems import FieldError

Reason: TypeAlias = Literal["queue_full", "deadline", "overloaded"]


class InvalidField(Exception):
    """A field at `pointer` that fits its schema, but not this service or the other fields."""

    def __init__(self, pointer: str, detail: str) -> None:
        super().__init__(detail)
        self.pointer = pointer


class InvalidFields(Exception):
    """Fields of one problem among many that do not fit their schema."""

    def __init__(self, errors: list[FieldError]) -> None:
        super().__init__("; ".join(f"{error.pointer}: {error.detail}" for error in errors))
        self.errors = errors


class OutOfOrder(Exception):
    """A message of a session that is not due."""


class NotReady(Exception):
    """The service is starting, could not start, or is draining."""


class Refused(Exception):
    """The request was not taken on; nothing was done for it."""

    def __init__(self, reason: Reason, detail: str, retry_after_s: float) -> None:
        super().__init__(detail)
        self.reason = reason
        self.retry_after_s = max(1, math.ceil(retry_after_s))


class DeadlineExceeded(Stopped):
    """The time for the request is up."""


class ClientGone(Stopped):
    """Nobody waits for the answer any more."""


class ShuttingDown(Stopped):
    """The service was told to end at once."""
