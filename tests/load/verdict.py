"""What was checked, and what was merely measured."""

from dataclasses import dataclass, field
from typing import NamedTuple

from rich.console import Console
from rich.table import Table


class Check(NamedTuple):
    """A measured value beside the most that it may be."""

    name: str
    measured: float
    limit: float
    unit: str
    is_timing: bool
    """Whether it says little where others keep the cores busy."""

    @property
    def passed(self) -> bool:
        return self.measured <= self.limit  # and not so if nothing was measured: a NaN


@dataclass
class Verdict:
    """The outcome of a run."""

    title: str
    checks: list[Check] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)
    """Measured and reported, without a limit."""
    cores_of_others: float = 0.0
    """Cores of this machine that neither the service nor its clients kept busy, but were."""

    @property
    def passed(self) -> bool:
        return all(check.passed for check in self.checks)

    @property
    def failures(self) -> list[str]:
        """The names of the checks that failed."""
        return [check.name for check in self.checks if not check.passed]

    def check(
        self,
        name: str,
        measured: float,
        limit: float = 0,
        unit: str = "",
        is_timing: bool = False,
    ) -> None:
        """Add a check: `measured` may be at most `limit`."""
        self.checks.append(Check(name, measured, limit, unit, is_timing))

    def note(self, name: str, value: str) -> None:
        """Add what is merely reported."""
        self.notes[name] = value

    def print(self, console: Console) -> None:
        table = Table("", "check", "measured", "at most", title=self.title)
        for check in self.checks:
            table.add_row(
                "ok" if check.passed else "FAILED",
                check.name,
                f"{check.measured:.4g} {check.unit}",
                f"{check.limit:.4g} {check.unit}",
                style="" if check.passed else "red",
            )
        console.print(table)
        for name, value in self.notes.items():
            console.print(f"{name}: {value}", highlight=False, soft_wrap=True)


def percentile(values: list[float], share: float) -> float:
    """Return the value that this share of `values` does not exceed; NaN if there are none."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")
