"""An estimate of one parameter, with its interval, and why it is none."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Parameter:
    """An estimate."""

    name: str
    """A field of `System`, with `.forward` or `.backward` where it differs by direction."""
    value: float
    standard_error: float
    interval: tuple[float, float]
    """95 %."""
    identifiable: bool
    why_not: str | None = None
