"""The frontier of samplers: paired with the paper's setting, at an honest margin."""

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import PAPER_DIFFUSION, PAPER_MODEL
from app.evaluation.question import Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites import sampler_frontier
from app.evaluation.suites.multistep_random import MultistepRandom
from app.evaluation.suites.sampler_frontier import (
    PAPER,
    SETTINGS,
    SamplerFrontier,
    entrant_of,
)
from app.planning.methods import ActionDiffusion
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Sampler
from tests.evaluation.synthetic import section_of, sequence_answer

SUITE = SamplerFrontier(seed=3, quick=True)
MARGIN = 0.125
"""With errors that binary numbers hold exactly, so that a difference may be just the margin."""
SMALL = 2.0**-10


def settled(setting: ActionDiffusion) -> Sampler:
    return setting.settled(PAPER_MODEL_SAMPLERS)


def evaluations(setting: ActionDiffusion) -> int:
    return settled(setting).cost(1).network_evaluations


def section(*more: float) -> Section:
    """All settings but the paper's are worse, by `more` on the first, second and third sequence."""

    def answer(question: Question) -> Answer:
        labels = question.labels
        worse = 0.0 if labels["entrant"] == PAPER_DIFFUSION.label else more[int(labels["task"])]
        return sequence_answer(0.5 / int(labels["num_candidates"]) + worse)

    return section_of(SUITE, answer)


def test_the_setting_of_the_paper_comes_first_and_each_other_once() -> None:
    assert SETTINGS[0] == PAPER
    assert len({settled(setting) for setting in SETTINGS}) == len(SETTINGS)
    assert len({entrant_of(setting) for setting in SETTINGS}) == len(SETTINGS)


def test_what_a_service_does_by_default_is_among_the_settings_and_named() -> None:
    assert settled(ActionDiffusion()) in [settled(setting) for setting in SETTINGS]
    assert (
        "default with this model is DPM-Solver++ with 3 steps, s = 2"
        in section(0, 0, 0).all(str)[0]
    )


def test_requests_have_the_settings_that_their_labels_say() -> None:
    methods = []
    for question in SUITE.questions():
        method = question.request.method
        assert isinstance(method, ActionDiffusion)
        methods.append(method)
        settings = settled(method).settings
        assert question.labels["steps"] == settings.steps
        assert question.labels["guidance_scale"] == settings.guidance_scale
        assert question.request.model == PAPER_MODEL
    assert methods == [
        setting for _ in SUITE.size.budgets for setting in SETTINGS for _ in range(3)
    ]


def test_what_the_random_sequences_suite_asks_of_the_paper_s_setting_is_not_asked_again() -> None:
    own = {question.key for question in SamplerFrontier(seed=3).questions()}
    paper_s = {
        question.key
        for question in MultistepRandom(seed=3).questions()
        if question.labels["entrant"] == PAPER_DIFFUSION.label
        and question.labels["num_candidates"] in (16, 128)
        and question.labels["run"] == 0
    }
    assert len(paper_s) == 2 * 30
    assert paper_s <= own


@pytest.mark.parametrize(
    ("more", "inferior"),
    [
        ((0, 0, 0), False),
        ((MARGIN, MARGIN, MARGIN), False),
        ((MARGIN + SMALL,) * 3, True),
        ((-0.25, -0.25, 0.5), True),
        ((-0.25, -0.25, -0.125), False),
    ],
    ids=["equal", "just the margin", "just above it", "in doubt", "better"],
)
def test_an_asterisk_marks_what_may_be_worse_by_more_than_the_margin(
    monkeypatch: pytest.MonkeyPatch, more: tuple[float, ...], inferior: bool
) -> None:
    monkeypatch.setattr(sampler_frontier, "MARGIN", MARGIN)

    (table,) = section(*more).all(Table)

    assert "0.125 m worse" in table.caption
    assert all(("*" in cell) == inferior for row in table.rows[1:] for cell in row[4:])


def test_a_row_holds_all_budgets_and_the_setting_of_the_paper_is_compared_with_nothing() -> None:
    (table,) = section(0.25, 0.25, 0.25).all(Table)

    assert table.headings == ("Sampler", "Steps", "s", "Evaluations", "K = 1", "K = 4")
    assert len(table.rows) == len(SETTINGS)
    assert table.rows[0] == ("DDIM (paper)", "50", "2", "100", "0.500", "0.125")
    assert table.rows[8] == (
        "DPM-Solver++", "1", "1", "1",
        "0.750* (+0.250 [+0.250, +0.250])", "0.375* (+0.250 [+0.250, +0.250])",
    )  # fmt: skip


def test_the_same_answers_make_the_same_table() -> None:
    assert section(0.1, 0.2, 0.3).all(Table) == section(0.1, 0.2, 0.3).all(Table)


def test_every_setting_is_drawn_in_the_panel_of_its_k_and_nothing_else() -> None:
    def error(evaluations: int, k: int) -> float:
        return float(k * evaluations)

    def answer(question: Question) -> Answer:
        assert isinstance(question.request.method, ActionDiffusion)
        k = question.request.num_candidates
        return sequence_answer(error(evaluations(question.request.method), k))

    (picture,) = section_of(SUITE, answer).all(Picture)

    for axes, k in zip(picture.figure.axes, SUITE.size.budgets, strict=True):
        *lines, reference, star = axes.lines
        points = [tuple(xy) for line in lines for xy in np.asarray(line.get_xydata()).tolist()]
        assert sorted(points) == sorted(
            (evaluations(setting), error(evaluations(setting), k)) for setting in SETTINGS
        )
        assert set(np.asarray(reference.get_ydata())) == {error(100, k)}
        assert np.asarray(star.get_xydata()).tolist() == [[100, error(100, k)]]
