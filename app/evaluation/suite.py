"""What an evaluation suite is: questions for a service, and a section made of its answers."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, NamedTuple, TypeAlias, TypeVar

import pandas as pd
from matplotlib.figure import Figure

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import ENTRANTS
from app.evaluation.measures import measures
from app.evaluation.question import Entrant, Question
from app.evaluation.tasks import DrawTasks, Task, request_seed

Row: TypeAlias = Mapping[str, Any]


class Table(NamedTuple):
    """A table of finished cells."""

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    part: str = ""
    """Follows the suite's name in that of its LaTeX file; the main table has none."""


class Picture(NamedTuple):
    """The suite's figure with its caption."""

    caption: str
    figure: Figure


class Claim(NamedTuple):
    """A statement of the paper, and what our numbers say to it."""

    statement: str
    confirmed: bool
    evidence: str


Part: TypeAlias = str | Table | Picture | Claim
Parts: TypeAlias = Iterator[Part]
Kind = TypeVar("Kind", bound=Part)


class Section(NamedTuple):
    """A suite's part of the report: at most one picture, and of all else any number."""

    name: str
    """Of the suite, and of its files."""
    title: str
    parts: Sequence[Part]
    data: pd.DataFrame

    def all(self, kind: type[Kind]) -> list[Kind]:
        """Return the parts of a kind, in their order."""
        return [part for part in self.parts if isinstance(part, kind)]


class Size(NamedTuple):
    """How much a suite asks: every run of every task, of every entrant at every K."""

    budgets: tuple[int, ...]
    """K."""
    tasks: int = 1
    runs: int = 1
    entrants: tuple[Entrant, ...] = ENTRANTS


@dataclass(frozen=True)
class Suite(ABC):
    """An evaluation: what it asks depends on its seed and size alone.

    The docstring of a suite is one line, for whoever asks which suites there are. `quick` is the
    same evaluation in seconds; its numbers say little.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    """Of its section."""
    draw_tasks: ClassVar["staticmethod[[int, int], Sequence[Task]]"]
    """The seed and the size decide, never the method or K.

    A suite of several plants has none, and says with each question whose tasks they are.
    """
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

    def questions(self) -> Iterator[Question]:
        """List all that is asked."""
        for k, entrant in product(self.size.budgets, self.size.entrants):
            yield from self.ask(entrant, k)

    def ask(
        self,
        entrant: Entrant,
        num_candidates: int,
        draw_tasks: DrawTasks | None = None,
        *,
        if_covered: bool = False,
        **labels: str | float,
    ) -> Iterator[Question]:
        """Ask an entrant for every run of every task.

        Args:
            entrant: who is asked.
            num_candidates: K.
            draw_tasks: where the suite has none of its own.
            if_covered: whether nothing is asked where no model covers the plant.
            labels: more columns of the data.

        Raises:
            ValidationError: the service would refuse such a request.
        """
        tasks = (draw_tasks or self.draw_tasks)(self.size.tasks, self.seed)
        who = labels | {"entrant": entrant.label, "num_candidates": num_candidates}
        for (number, task), run in product(enumerate(tasks), range(self.size.runs)):
            request = entrant.request(task, num_candidates, request_seed(self.seed, number, run))
            yield Question(
                who | {"task": number, "run": run}, request, self.trajectories, if_covered
            )

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Return what an answer adds to the suite's data: by default one row of its measures."""
        return [{**question.labels, **measures(answer)}]

    @abstractmethod
    def report(self, data: pd.DataFrame) -> Parts:
        """Write the suite's part of the report.

        Args:
            data: the rows of all answers, in the order of the questions; the column `answer` has
                the answers themselves, for suites that draw trajectories.
        """

    def section(self, answered: Iterable[tuple[Question, Answer]]) -> Section:
        """Make the suite's section of the answers to its questions, in their order."""
        data = pd.DataFrame(
            {**row, "answer": answer}
            for question, answer in answered
            for row in self.rows(question, answer)
        )
        return Section(self.name, self.title, tuple(self.report(data)), data.drop(columns="answer"))
