"""What an evaluation suite is: questions for a service, and a section made of its answers."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeAlias

import pandas as pd

from app.evaluation.answer_log import Answer
from app.evaluation.measures import measures
from app.evaluation.question import Question
from app.evaluation.section import Section

Row: TypeAlias = Mapping[str, Any]
Answered: TypeAlias = list[tuple[Question, Answer]]


@dataclass(frozen=True)
class Suite(Protocol):
    """An evaluation: the tasks depend on its seed and size alone.

    `quick` is the same evaluation in seconds; its numbers say little.
    """

    name: ClassVar[str]
    purpose: ClassVar[str]
    """One line, for whoever asks which suites there are."""

    seed: int
    quick: bool = False

    def questions(self) -> Iterator[Question]:
        """List all that is asked."""
        ...

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Return what an answer adds to the suite's data: by default one row of its measures."""
        return [{**question.labels, **measures(answer)}]

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        """Write the suite's part of the report.

        Args:
            data: the rows of all answers, in the order of the questions.
            answered: the answers themselves, for suites that draw trajectories.
        """
        ...
