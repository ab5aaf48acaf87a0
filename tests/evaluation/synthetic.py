"""Answers that no service gave, for suites to make their sections of."""

from collections.abc import Callable

from app.evaluation.answer_log import Answer
from app.evaluation.question import Question
from app.evaluation.suite import Section, Suite, Table


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
        "segments": [{"control_energy": 1.0}] * 3,
    }
    return _answer(content, stuck_steps, compute_ms)


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
