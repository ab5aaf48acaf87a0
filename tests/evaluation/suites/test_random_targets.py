"""Random targets: the same ones for everybody, and those out of reach apart."""

import numpy as np
import pytest
from matplotlib.patches import StepPatch

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import DIFFUSION, ENTRANTS, PAPER_DIFFUSION, UNIFORM
from app.evaluation.question import Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites.random_targets import RandomTargets
from app.evaluation.tasks import transition_tasks
from tests.evaluation.synthetic import assert_asked_alike, plan_answer, section_of, split

SUITE = RandomTargets(seed=3, quick=True)
TASKS = 12
FLOOR = 0.03
GAPS = {PAPER_DIFFUSION.label: 0.04, DIFFUSION.label: 0.0, UNIFORM.label: 2.0}


def section(unreachable: int = 3, compute_ms: float = 1.0) -> Section:
    """The first tasks are out of reach."""

    def answer(question: Question) -> Answer:
        floor = FLOOR * (int(question.labels["task"]) < unreachable)
        gap = GAPS.get(str(question.labels["entrant"]), 0.2)
        given = plan_answer(gap, compute_ms=compute_ms)
        reachability = {"floor": floor, "reachable": not floor}
        content = {"terminal_error": floor + gap, "reachability": reachability}
        return Answer({**given.content, **content}, given.latency_ms)

    return section_of(SUITE, answer)


def cells(table: Table, method: str) -> dict[str, str]:
    (row,) = (row for row in table.rows if row[0] == method)
    return dict(zip(table.headings, row, strict=True))


def test_everybody_gets_the_same_tasks_and_seeds_at_every_k() -> None:
    whole = RandomTargets(seed=3)
    assert_asked_alike(whole, transition_tasks(500, 3), 2 * len(ENTRANTS))
    assert not any(question.trajectories for question in whole.questions())


def test_the_quick_evaluation_asks_some_of_the_questions_of_the_whole() -> None:
    whole = {question.key for question in RandomTargets(seed=3).questions()}
    quick = {question.key for question in SUITE.questions()}
    assert len(whole) == 500 * 2 * len(ENTRANTS)
    assert len(quick) == TASKS * len(ENTRANTS)
    assert quick < whole
    assert quick.isdisjoint(question.key for question in RandomTargets(4, quick=True).questions())


def test_success_is_counted_by_the_error_and_out_of_reach_by_the_gap_too() -> None:
    everything, reachable, unreachable, *_ = section().all(Table)
    assert "All targets (12)" in everything.caption
    assert "Reachable targets (9)" in reachable.caption
    assert "Unreachable targets (3)" in unreachable.caption
    paper = PAPER_DIFFUSION.label
    assert cells(everything, paper) == {
        "Method": paper,
        "K": "16",
        "Error within 0.01 m": "0 %",
        "Error within 0.05 m": "75 %",
        "Error within 0.1 m": "100 %",
        "Mean error (m)": "0.0475 ± 0.0130",
        "Median error (m)": "0.0400",
        "Mean gap (m)": "0.0400",
    }
    assert cells(reachable, paper)["Error within 0.05 m"] == "100 %"
    assert cells(unreachable, paper)["Error within 0.05 m"] == "0 %"
    assert cells(unreachable, paper)["Gap within 0.05 m"] == "100 %"
    assert "Gap within 0.05 m" not in reachable.headings


@pytest.mark.parametrize(("unreachable", "kind"), [(0, "reachable"), (TASKS, "unreachable")])
def test_there_is_no_table_of_no_tasks(unreachable: int, kind: str) -> None:
    parts = [table.part for table in section(unreachable).all(Table)]
    assert parts[:3] == ["", kind, "statistics"]


def test_differences_are_paired_and_wins_counted() -> None:
    *_, statistics, _, wins = section().all(Table)
    ours = cells(statistics, DIFFUSION.label)
    assert ours["Less Action Diffusion (paper) (m)"] == "-0.0400 [-0.0400, -0.0400]"
    assert wins.part == "wins-16"
    assert cells(wins, DIFFUSION.label)[PAPER_DIFFUSION.label] == "100 %"
    assert cells(wins, UNIFORM.label)[PAPER_DIFFUSION.label] == "0 %"


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later
    assert cells(later[0], DIFFUSION.label)["Client latency (ms)"] == "140.0 ± 0.0"


def test_the_picture_shows_the_share_of_tasks_within_each_gap() -> None:
    (axes,) = section().all(Picture)[0].figure.axes
    steps = {patch.get_label(): patch for patch in axes.patches}
    assert list(steps) == [entrant.label for entrant in ENTRANTS]
    patch = steps[PAPER_DIFFUSION.label]
    assert isinstance(patch, StepPatch)
    shares, gaps, _ = patch.get_data()
    np.testing.assert_allclose(shares, np.arange(1, TASKS + 1) / TASKS)
    np.testing.assert_allclose(gaps, [0.04] * TASKS + [1.0])


def test_the_picture_has_exact_plans_at_its_edge() -> None:
    (axes,) = section().all(Picture)[0].figure.axes
    patch = next(patch for patch in axes.patches if patch.get_label() == DIFFUSION.label)
    assert isinstance(patch, StepPatch)
    _, gaps, _ = patch.get_data()
    assert gaps[0] == axes.get_xlim()[0]
