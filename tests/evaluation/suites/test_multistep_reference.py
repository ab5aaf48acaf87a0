"""Figure 4: everybody gets the same runs, which are drawn one by one, and claims on them."""

from dataclasses import asdict
from functools import cache

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import CEM, PAPER_DIFFUSION
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.multistep_reference import COMPARED, MultistepReference
from app.planning.plant.system import System
from tests.evaluation.synthetic import assert_asked_alike, section_of, sequence_answer, split

SUITE = MultistepReference(seed=3, quick=True)
LOW, HIGH = SUITE.size.budgets

Run = tuple[float, float]
"""Mean end error (m), and how far from the start the mass gets (m)."""
World = dict[tuple[Entrant, int], tuple[Run, Run]]
WORLD: World = {
    (PAPER_DIFFUSION, LOW): ((0.02, 0.4), (0.03, 0.41)),
    (PAPER_DIFFUSION, HIGH): ((0.01, 0.4), (0.01, 0.42)),
    (CEM, LOW): ((0.3, 0.05), (0.31, 0.07)),
    (CEM, HIGH): ((0.11, 0.3), (0.12, 0.4)),
}
"""A world in which all is as the paper says."""


def section(world: World = WORLD, compute_ms: float = 1.0) -> Section:
    by_label = {entrant.label: entrant for entrant in COMPARED}

    def answer(question: Question) -> Answer:
        labels = question.labels
        asked = by_label[str(labels["entrant"])], int(labels["num_candidates"])
        error, way = world.get(asked, ((0.2, 0.2), (0.2, 0.2)))[int(labels["run"])]
        measured = sequence_answer(error, compute_ms=compute_ms)
        trajectory = {
            "system": asdict(System()),
            "states": [(position, 0.0) for position in np.linspace(0, way, 7)],
            "controls": [way] * 6,
        }
        return Answer({**measured.content, **trajectory}, measured.latency_ms)

    return section_of(SUITE, answer)


@cache
def section_as_in_the_paper() -> Section:
    return section()


def test_everybody_gets_the_same_runs_at_every_k() -> None:
    targets = [(0.4, 0.0), (-0.4, 0.0), (0.2, 0.0)]
    task = {"initial_state": (0.0, 0.0), "targets": targets, "include": ["states"]}
    assert_asked_alike(SUITE, [task], len(COMPARED) * len(SUITE.size.budgets))
    assert all(question.trajectories for question in SUITE.questions())


def test_the_whole_evaluation_is_the_paper_s_in_size() -> None:
    whole = {question.key for question in MultistepReference(seed=3).questions()}
    assert len(whole) == 2 * 5 * len(COMPARED)


def test_a_row_for_each_method_and_k() -> None:
    errors, times = section_as_in_the_paper().all(Table)
    for table in (errors, times):
        assert len(table.rows) == len(COMPARED) * len(SUITE.size.budgets)
        assert {len(row) for row in table.rows} == {len(table.headings)}
    assert errors.rows[2] == (
        CEM.label, "16", "0.305 ± 0.005", "0.000", "0.0 ± 0.0", "0.060 ± 0.010", "0.005",
    )  # fmt: skip
    assert times.rows[2] == (CEM.label, "16", "1.0 ± 0.0", "2.0 ± 0.0")


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later


def test_runs_and_their_mean_are_drawn_in_a_column_for_each_method() -> None:
    (picture,) = section_as_in_the_paper().all(Picture)
    panels = np.array(picture.figure.axes).reshape(4, len(COMPARED))
    assert [axes.get_title() for axes in panels[0]] == [entrant.label for entrant in COMPARED]
    for axes in panels.flat:
        first, second, mean = (np.asarray(line.get_ydata()) for line in axes.lines)
        np.testing.assert_allclose(mean, (first + second) / 2)


def test_claims_hold_where_all_is_as_the_paper_says() -> None:
    claims = section_as_in_the_paper().all(Claim)
    assert [claim.confirmed for claim in claims] == [True] * 4
    assert f"{PAPER_DIFFUSION.label} 0.020 to 0.030 m, {CEM.label} 0.300 to 0.310 m" in (
        claims[0].evidence
    )
    assert claims[1].evidence.endswith("CEM's runs range over 0.050 to 0.070 m.")
    assert "0.305 m at K = 16 and 0.115 m at K = 32" in claims[2].evidence
    assert claims[3].evidence.endswith(f"{PAPER_DIFFUSION.label} 0.005 m, {CEM.label} 0.025 m.")


@pytest.mark.parametrize(
    ("number", "changed"),
    [
        (0, {(PAPER_DIFFUSION, LOW): ((0.02, 0.4), (0.32, 0.4))}),
        (1, {(CEM, LOW): ((0.3, 0.05), (0.31, 0.3))}),
        (2, {(CEM, HIGH): ((0.32, 0.3), (0.33, 0.4))}),
        (2, {(CEM, HIGH): ((0.05, 0.3), (0.12, 0.4))}),
        (3, {(CEM, HIGH): ((0.11, 0.4), (0.12, 0.4))}),
    ],
)
def test_a_claim_fails_where_the_runs_are_otherwise(number: int, changed: World) -> None:
    assert not section(WORLD | changed).all(Claim)[number].confirmed
