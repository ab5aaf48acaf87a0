"""Claims of the kinds that recur: who is lower than whom, and who is lowest of all."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from app.evaluation.case import Case
from app.evaluation.question import Entrant
from app.evaluation.statistics import Interval
from app.evaluation.suite import Claim


class Lead(NamedTuple):
    """What Action Diffusion has less of an error than another method, in pairs, at each place."""

    other: str
    differences: Mapping[str, Interval]
    """Of Action Diffusion less the other (m), negative where it leads; by the place."""
    digits: int = 3

    @property
    def narrows(self) -> bool:
        """Whether it is smaller at the last place than at the first."""
        first, *_, last = self.differences.values()
        return last.estimate > first.estimate

    def __str__(self) -> str:
        shown = (
            f"{difference.shown(self.digits, '+')} m at {place}"
            for place, difference in self.differences.items()
        )
        return f"Action Diffusion less {self.other}: {', '.join(shown)}."


def lead_over(other: Entrant, cases: Iterable[Case], measure: str) -> Lead:
    """Measure the lead of Action Diffusion's `cases` over `other`, paired by the tasks."""
    return Lead(other.label, {case.place: case.less(other, measure) for case in cases})


def lower(statement: str, *leads: Lead) -> Claim:
    """Claim that Action Diffusion is lower than others, each paired interval below zero."""
    certain = all(below.high < 0 for lead in leads for below in lead.differences.values())
    return Claim(statement, certain, " ".join(map(str, leads)))


def lowest(
    statement: str, entrant: Entrant, values: Mapping[str, Mapping[Entrant, float]], form: str
) -> Claim:
    """Claim that `entrant` has the lowest value of all, at every place.

    Args:
        statement: of the paper.
        entrant: who leads.
        values: of each entrant, by the place.
        form: how a value is written, as in "{:.3f} m".
    """
    shown = (
        f"{place}: " + ", ".join(f"{each.label} {form.format(row[each])}" for each in row)
        for place, row in values.items()
    )
    leads = all(
        row[entrant] < row[other] for row in values.values() for other in row if other != entrant
    )
    return Claim(statement, leads, f"{'; '.join(shown)}.")
