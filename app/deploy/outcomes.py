"""What comes back from a replica: an answer, or an error that reaches the routes as it was raised.

Ray would wrap an error, and pickle cannot carry one whose arguments are not its message.
"""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from app.deploy.routing import Load

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Raised:
    """An error, taken apart."""

    kind: type[Exception]
    args: tuple[Any, ...]
    fields: dict[str, Any]

    @classmethod
    def of(cls, error: Exception) -> "Raised":
        return cls(type(error), error.args, dict(vars(error)))

    def error(self) -> Exception:
        """Return it whole again."""
        error: Exception = self.kind.__new__(self.kind, *self.args)
        vars(error).update(self.fields)
        return error


@dataclass(frozen=True, slots=True)
class Outcome(Generic[T]):
    """What a replica made of something, and how it is since."""

    replica: str
    load: Load
    result: "T | Raised"

    def unwrap(self) -> T:
        """Return the result.

        Raises:
            Exception: what the replica raised.
        """
        if isinstance(self.result, Raised):
            raise self.result.error()
        return self.result
