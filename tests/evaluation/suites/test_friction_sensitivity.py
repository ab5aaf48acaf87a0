"""Table 3: the questions of Table 2 again where the plant is nominal, and what the claim needs."""

from collections.abc import Mapping

import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    ENTRANTS,
    PAPER_DIFFUSION,
    REFINED_PRIOR,
)
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.friction_sensitivity import (
    FRICTIONS,
    OWN_MODEL,
    TRAINED_FOR_EACH,
    FrictionSensitivity,
)
from app.evaluation.suites.multistep_random import MultistepRandom
from app.evaluation.tasks import sequence_tasks
from app.planning.plant.system import System
from tests.evaluation.synthetic import assert_asked_alike, section_of, sequence_answer, split

WHOLE = FrictionSensitivity(seed=3)
SUITE = FrictionSensitivity(seed=3, quick=True)

World = Mapping[tuple[Entrant, float], float]
ERRORS: World = {
    (entrant, friction): {PAPER_DIFFUSION: 0.1, OWN_MODEL: 0.09, CEM: 0.3, DATASET_PRIOR: 0.4}.get(
        entrant, 0.05
    )
    for entrant in SUITE.size.entrants
    for friction in FRICTIONS
}
"""A world in which all is as the paper says."""


def section(errors: World = ERRORS, compute_ms: float = 1.0) -> Section:
    by_label = {entrant.label: entrant for entrant in SUITE.size.entrants}

    def answer(question: Question) -> Answer:
        labels = question.labels
        asked = by_label[str(labels["entrant"])], float(labels["static_friction"])
        # Some tasks are harder than others, for everybody.
        error = errors[asked] + 0.01 * int(labels["task"])
        return sequence_answer(error, compute_ms=compute_ms)

    return section_of(SUITE, answer)


def test_everybody_gets_the_same_tasks_and_seeds_for_every_friction() -> None:
    tasks = sequence_tasks(3, SUITE.seed)
    assert_asked_alike(SUITE, tasks, len(SUITE.size.entrants) * len(FRICTIONS))


def test_the_whole_evaluation_is_the_paper_s_in_size() -> None:
    questions = list(WHOLE.questions())
    assert len(questions) == len({question.key for question in questions})
    assert len(questions) == 3 * 30 * 5 * (len(ENTRANTS) + 1)
    assert {question.plan.num_candidates for question in questions} == {128}


def test_static_friction_alone_differs_and_goes_unsaid_where_it_is_nominal() -> None:
    plants = {question.labels["static_friction"]: question.plan.system for question in
              SUITE.questions()}  # fmt: skip
    assert plants == {
        0.6: System(static_friction=0.6),
        0.7: None,
        0.8: System(static_friction=0.8),
    }


def test_those_trained_for_each_friction_name_their_models_and_nobody_else_does() -> None:
    models = {
        (question.labels["entrant"], question.labels["static_friction"]): question.plan.model
        for question in SUITE.questions()
    }
    for (entrant, friction), model in models.items():
        has_own = entrant in {each.label for each in TRAINED_FOR_EACH}
        assert model == (f"dry-friction-fs{friction}" if has_own else None)


@pytest.mark.parametrize("quick", [False, True])
def test_questions_on_the_nominal_plant_are_those_of_the_random_multistep_suite(
    quick: bool,
) -> None:
    suite, other = FrictionSensitivity(3, quick), MultistepRandom(3, quick)
    elsewhere = {
        question.key
        for question in other.questions()
        if question.plan.num_candidates in suite.size.budgets
    }
    own: dict[bool, set[str]] = {True: set(), False: set()}
    for question in suite.questions():
        if question.labels["entrant"] == OWN_MODEL.label:
            continue
        own[question.labels["static_friction"] == 0.7].add(question.key)
    assert own[True] <= elsewhere
    assert own[True] == elsewhere or quick
    assert own[False].isdisjoint(elsewhere)


def test_a_row_for_each_method_with_the_paper_s_numbers_beside() -> None:
    errors, statistics, times = section().all(Table)
    assert errors.rows[0] == (
        PAPER_DIFFUSION.label, "0.110 ± 0.008", "0.14 ± 0.1", "0.000", "0.110 ± 0.008",
        "0.15 ± 0.1", "0.000", "0.110 ± 0.008", "0.10 ± 0.1", "0.000",
    )  # fmt: skip
    assert errors.rows[-2][:3] == (REFINED_PRIOR.label, "0.060 ± 0.008", "")
    assert statistics.rows[1] == (
        DATASET_PRIOR.label, "0.6", "0.410 [0.400, 0.420]", "+0.300 [+0.300, +0.300]"
    )  # fmt: skip
    assert times.rows[0] == (PAPER_DIFFUSION.label, "0.6", "1.0 ± 0.0", "2.0 ± 0.0")
    for table in (errors, statistics, times):
        assert {len(row) for row in table.rows} == {len(table.headings)}


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later


def test_a_line_of_each_method_is_drawn() -> None:
    (picture,) = section().all(Picture)
    (axes,) = picture.figure.axes
    assert [line.get_label() for line in axes.containers] == [
        of.label for of in SUITE.size.entrants
    ]


def test_the_claim_holds_where_action_diffusion_leads_for_every_friction() -> None:
    claim, one_model = section().all(Claim)
    assert claim.confirmed
    assert one_model.confirmed
    assert "CEM (40 it.): -0.200 [-0.200, -0.200] m at f_s = 0.6" in claim.evidence


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("other", [CEM, DATASET_PRIOR])
def test_the_claim_fails_where_another_is_as_good_for_one_friction(
    other: Entrant, friction: float
) -> None:
    claim, _ = section({**ERRORS, (other, friction): 0.1}).all(Claim)
    assert not claim.confirmed
    assert f"+0.000 [+0.000, +0.000] m at f_s = {friction}" in claim.evidence


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("own", TRAINED_FOR_EACH)
def test_one_model_is_not_better_where_one_of_the_others_is_as_good(
    own: Entrant, friction: float
) -> None:
    _, claim = section({**ERRORS, (own, friction): 0.05}).all(Claim)
    assert not claim.confirmed
