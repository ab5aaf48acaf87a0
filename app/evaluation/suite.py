"""What an evaluation suite is: questions for a service, and a section made of its answers."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, TypeAlias

import pandas as pd

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import ENTRANTS
from app.evaluation.measures import measures
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Section
from app.evaluation.tasks import Task, request_seed
from app.wire.requests import MultistepPlanRequest, PlanRequest

Row: TypeAlias = Mapping[str, Any]
Answered: TypeAlias = list[tuple[Question, Answer]]


@dataclass(frozen=True, slots=True)
class Size:
    """How much a suite asks: every run of every task, of every entrant at every K."""

    budgets: tuple[int, ...]
    """K."""
    tasks: int = 1
    runs: int = 1
    entrants: tuple[Entrant, ...] = ENTRANTS


@dataclass(frozen=True)
class Suite(ABC):
    """An evaluation: what it asks depends on its seed and size alone.

    `quick` is the same evaluation in seconds; its numbers say little.
    """

    name: ClassVar[str]
    purpose: ClassVar[str]
    """One line, for whoever asks which suites there are."""
    FULL: ClassVar[Size]
    QUICK: ClassVar[Size]
    trajectories: ClassVar[bool] = False
    """Whether controls, states and candidates of the answers are wanted, or measures alone."""

    seed: int
    quick: bool = False

    @property
    def size(self) -> Size:
        """How much is asked."""
        return self.QUICK if self.quick else self.FULL

    @abstractmethod
    def tasks(self) -> Sequence[Task]:
        """List the tasks: the seed and the size decide, never the method or K."""

    def questions(self) -> Iterator[Question]:
        """List all that is asked."""
        for k, entrant in product(self.size.budgets, self.size.entrants):
            yield from self.ask(entrant, k)

    def ask(
        self, entrant: Entrant, num_candidates: int, **labels: str | float
    ) -> Iterator[Question]:
        """Ask an entrant for every run of every task; `labels` are more columns of the data.

        Raises:
            ValidationError: the service would refuse such a request.
        """
        for (number, task), run in product(enumerate(self.tasks()), range(self.size.runs)):
            kind = MultistepPlanRequest if "targets" in task else PlanRequest
            fields = {
                **entrant.fields,
                "num_candidates": num_candidates,
                "seed": request_seed(self.seed, number, run),
                "include": [],
                **task,
            }
            placed = {
                **labels,
                "entrant": entrant.label,
                "num_candidates": num_candidates,
                "task": number,
                "run": run,
            }
            yield Question(placed, kind.model_validate(fields), self.trajectories)

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Return what an answer adds to the suite's data: by default one row of its measures."""
        return [{**question.labels, **measures(answer)}]

    @abstractmethod
    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        """Write the suite's part of the report.

        Args:
            data: the rows of all answers, in the order of the questions.
            answered: the answers themselves, for suites that draw trajectories.
        """
