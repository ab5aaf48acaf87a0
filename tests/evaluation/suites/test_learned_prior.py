"""The learned prior against the dataset prior: paired tasks, every entrant, times apart."""

from collections import defaultdict

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import (
    DATASET_PRIOR,
    DIFFUSION,
    REFINED_DIFFUSION,
    UNIFORM,
)
from app.evaluation.question import Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites.learned_prior import (
    DESCENT,
    EXACT_GAP,
    LEAST_ENERGY,
    REPAIR,
    SUCCESS_GAP,
    WAYS,
    LearnedPrior,
)
from app.evaluation.suites.random_targets import RandomTargets
from app.evaluation.tasks import transition_tasks
from tests.evaluation.synthetic import assert_asked_alike, plan_answer, section_of, split

SUITE = LearnedPrior(seed=3, quick=True)
TASKS = SUITE.size.tasks


def section(compute_ms: float = 1.0) -> Section:
    """By descent alone the dataset prior misses half of the tasks, and takes more energy."""

    def answer(question: Question) -> Answer:
        labels = question.labels
        behind = labels["entrant"] == DATASET_PRIOR.label and labels["refined_by"] == DESCENT.label
        return plan_answer(
            gap=0.5 * (behind and int(labels["task"]) % 2),
            control_energy=20 + int(labels["task"]) + 0.25 * behind,
            compute_ms=compute_ms * int(labels["num_candidates"]) + int(labels["task"]),
        )

    return section_of(SUITE, answer)


def test_everybody_gets_the_same_tasks_and_seeds() -> None:
    assert_asked_alike(SUITE, transition_tasks(TASKS, SUITE.seed), 27)


def test_the_uniform_and_larger_budgets_take_part_where_they_tell_something() -> None:
    questions = list(SUITE.questions())
    assert len(questions) == len({question.key for question in questions}) == 27 * TASKS
    budgets = defaultdict(set)
    for question in questions:
        labels = question.labels
        budgets[labels["refined_by"], labels["entrant"]].add(labels["num_candidates"])
    assert budgets == {
        **{
            (way.label, entrant.label): {1, 4, 16}
            for way in (DESCENT, REPAIR)
            for entrant in (DIFFUSION, DATASET_PRIOR, UNIFORM)
        },
        (LEAST_ENERGY.label, DIFFUSION.label): {1, 4, 16},
        (LEAST_ENERGY.label, DATASET_PRIOR.label): {1, 4, 16, 64, 256, 1024},
    }


def test_requests_are_refined_as_their_labels_say() -> None:
    for question in SUITE.questions():
        way, request = question.labels["refined_by"], question.plan
        assert request.refine is not None
        assert request.refine.repair == (way != DESCENT.label)
        assert (request.objective == "control_energy") == (way == LEAST_ENERGY.label)


def test_what_other_suites_ask_for_is_the_same_question() -> None:
    asked = {question.key for question in SUITE.questions()}
    elsewhere = list(RandomTargets(seed=3, quick=True).ask(REFINED_DIFFUSION, 16))
    assert asked.issuperset(question.key for question in elsewhere[:TASKS])


@pytest.mark.parametrize(
    ("gap", "success", "exact"),
    [
        (0.0, True, True),
        (float(np.nextafter(EXACT_GAP, 0)), True, True),
        (EXACT_GAP, True, False),
        (float(np.nextafter(SUCCESS_GAP, 0)), True, False),
        (SUCCESS_GAP, False, False),
    ],
)
def test_success_and_exactness_are_read_off_the_gap(gap: float, success: bool, exact: bool) -> None:
    question = next(SUITE.questions())
    (row,) = SUITE.rows(question, plan_answer(gap))
    assert (row["gap"], row["success"], row["exact"]) == (gap, success, exact)
    assert row["refined_by"] == DESCENT.label


def test_tables_hold_everybody_and_the_paired_differences() -> None:
    results, differences, targets, times = section().all(Table)
    assert [len(table.rows) for table in (results, differences, targets, times)] == [27, 9, 9, 27]
    assert results.rows[1] == (
        DESCENT.label, DATASET_PRIOR.label, "1", "50.0 %", "50.0 %", "23.8", "1.00", "0.0",
    )  # fmt: skip
    way, k, success, _, energy, *_ = differences.rows[0]
    assert (way, k) == (DESCENT.label, "1")
    assert success.startswith("+0.500 [+0.")
    assert energy == "-0.250 [-0.250, -0.250]"
    assert differences.rows[3][:3] == (REPAIR.label, "1", "+0.000 [+0.000, +0.000]")
    # Every other target moves, and the dataset prior misses those.
    assert targets.rows[1] == (DATASET_PRIOR.label, "1", "50.0 %", "100.0 %", "0.0 %", "")
    assert times.rows[-1] == (LEAST_ENERGY.label, DATASET_PRIOR.label, "1024", "1027.50")


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later


def test_each_way_of_refining_is_drawn_with_what_the_prior_buys() -> None:
    (picture,) = section().all(Picture)
    success, energy, _ = picture.figure.axes
    for axes, bought in ((success, 0.5), (energy, -0.25)):
        drawn = {}
        for container in axes.containers:
            assert isinstance(container, ErrorbarContainer)
            drawn[container.get_label()] = np.asarray(container.lines[0].get_ydata()).tolist()
        assert drawn == {way.label: [bought * (way == DESCENT)] * 3 for way in WAYS}
