"""Answers that no service gave, for suites to make their sections of."""

from collections import defaultdict
from collections.abc import Callable, Sequence

from app.evaluation.answer_log import Answer
from app.evaluation.question import Question
from app.evaluation.suite import Section, Suite, Table
from app.evaluation.tasks import Task, request_seed


def plan_answer(
    gap: float = 0.0,
    control_energy: float = 1.0,
    control_smoothness: float = 1.0,
    stuck_steps: int = 0,
    compute_ms: float = 1.0,
) -> Answer:
    content = {
        "terminal_error": gap,
        "gap": gap,
        "reachability": {"floor": 0.0, "reachable": True},
        "control_energy": control_energy,
        "control_smoothness": control_smoothness,
    }
    return _answer(content, stuck_steps, compute_ms)


def sequence_answer(
    mean_end_error: float = 0.0, stuck_steps: int = 0, compute_ms: float = 1.0
) -> Answer:
    content = {
        "final_error": mean_end_error,
        "mean_end_error": mean_end_error,
        "mean_end_floor": 0.0,
        "segments": [{"control_energy": 1.0, "diversity": 0.1}] * 3,
    }
    return _answer(content, stuck_steps, compute_ms)


def assert_asked_alike(
    suite: Suite, tasks: Sequence[Task], number: int, **where: str | int
) -> None:
    """So many as are told apart are all asked for the same runs of `tasks`, with the same seeds.

    Where the labels are those of `where`.
    """
    asked = defaultdict(list)
    for question in suite.questions():
        who = dict(question.labels)
        if not where.items() <= who.items():
            continue
        task, run = int(who.pop("task")), int(who.pop("run"))
        fields = {name: getattr(question.request, name) for name in tasks[task]}
        asked[tuple(who.values())].append((task, run, fields, question.request.seed))
    assert len(asked) == number
    expected = [
        (index, run, task, request_seed(suite.seed, index, run))
        for index, task in enumerate(tasks)
        for run in range(suite.size.runs)
    ]
    assert all(questions == expected for questions in asked.values())


def section_of(suite: Suite, answer: Callable[[Question], Answer]) -> Section:
    """The section that `suite` makes where each question has its `answer`."""
    return suite.section((question, answer(question)) for question in suite.questions())


def split(section: Section) -> tuple[list[Table], list[Table]]:
    """The tables of results, and those of times."""
    times = [table for table in section.all(Table) if table.part == "time"]
    return [table for table in section.all(Table) if table not in times], times


def _answer(measures: dict[str, object], stuck_steps: int, compute_ms: float) -> Answer:
    content = {
        "seed": 0,
        "stuck_steps": stuck_steps,
        "cost": {"network_evaluations": 0, "rollouts": 1},
        "timing_ms": {"queue": 0.5, "total": 0.5 + compute_ms},
    }
    return Answer(measures | content, latency_ms=2 * compute_ms)
