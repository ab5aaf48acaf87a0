"""The frontier of samplers: paired with the paper's setting, at an honest margin."""

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import ANY_MODEL, PAPER_DIFFUSION, PAPER_MODEL
from app.evaluation.question import Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites import sampler_frontier
from app.evaluation.suites.multistep_random import MultistepRandom
from app.evaluation.suites.sampler_frontier import (
    PAPER,
    SETTINGS,
    SamplerFrontier,
    Setting,
    entrant_of,
)
from app.inference.manifest import Manifest
from app.planning.methods import ActionDiffusion
from app.settings import SHIPPED_MODELS
from tests.evaluation.synthetic import section_of, sequence_answer

SUITE = SamplerFrontier(seed=3, quick=True)
MARGIN = 0.125
"""With errors that binary numbers hold exactly, so that a difference may be just the margin."""
SMALL = 2.0**-10


OF_PAPER_MODEL = [setting for setting in SETTINGS if setting.model == PAPER_MODEL]


def section(*more: float) -> Section:
    """All settings but the paper's are worse, by `more` on the first, second and third sequence."""

    def answer(question: Question) -> Answer:
        labels = question.labels
        worse = 0.0 if labels["entrant"] == PAPER_DIFFUSION.label else more[int(labels["task"])]
        return sequence_answer(0.5 / int(labels["num_candidates"]) + worse)

    return section_of(SUITE, answer)


def errors_of(found: Section) -> list[Table]:
    return [table for table in found.all(Table) if "mean end error" in table.caption]


def test_the_setting_of_the_paper_comes_first_and_each_other_once() -> None:
    assert SETTINGS[0] == PAPER
    assert len({(setting.model, setting.sampler) for setting in SETTINGS}) == len(SETTINGS)
    assert len({entrant_of(setting) for setting in SETTINGS}) == len(SETTINGS)


@pytest.mark.parametrize("model", [PAPER_MODEL, ANY_MODEL])
def test_what_the_shipped_models_do_by_default_is_among_the_settings(model: str) -> None:
    manifest = Manifest.read(SHIPPED_MODELS / model / "1" / "manifest.json")
    default = ActionDiffusion().settled(manifest.samplers)
    sizes = (default.solver, default.settings.steps, default.settings.guidance_scale)
    assert sizes in [
        (each.sampler.solver, each.sampler.settings.steps, each.sampler.settings.guidance_scale)
        for each in SETTINGS
        if each.model == model
    ]


def test_requests_have_the_settings_that_their_labels_say() -> None:
    settings = []
    for question in SUITE.questions():
        method, model = question.plan.method, question.plan.model
        assert isinstance(method, ActionDiffusion)
        assert model is not None
        settings.append(Setting(method, model))
        sampler = settings[-1].sampler.settings
        assert question.labels["steps"] == sampler.steps
        assert question.labels["guidance_scale"] == sampler.guidance_scale
        assert question.if_covered == (model == ANY_MODEL)
    assert settings == [
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

    for table in errors_of(section(*more)):
        assert "0.125 m worse" in table.caption
        compared = [row for row in table.rows if "paper" not in row[0]]
        assert compared
        assert all(("*" in cell) == inferior for row in compared for cell in row[4:])


def test_a_row_holds_all_budgets_and_the_setting_of_the_paper_is_compared_with_nothing() -> None:
    table, other = errors_of(section(0.25, 0.25, 0.25))

    assert table.headings == other.headings
    assert table.headings == ("Sampler", "Steps", "s", "Evaluations", "K = 1", "K = 4")
    assert len(table.rows) == len(OF_PAPER_MODEL)
    assert len(table.rows) + len(other.rows) == len(SETTINGS)
    assert table.rows[0] == ("DDIM (paper)", "50", "2", "100", "0.500", "0.125")
    assert table.rows[8] == (
        "DPM-Solver++", "1", "1", "1",
        "0.750* (+0.250 [+0.250, +0.250])", "0.375* (+0.250 [+0.250, +0.250])",
    )  # fmt: skip


def test_the_diversity_of_the_candidates_is_shown() -> None:
    found = section(0, 0, 0)
    shown = [table for table in found.all(Table) if "Diversity" in table.caption]
    assert [len(table.rows) for table in shown] == [len(table.rows) for table in errors_of(found)]
    assert all(row[4:] == ("0.100", "0.100") for table in shown for row in table.rows)


def test_where_answers_do_not_say_it_the_diversity_is_not_shown() -> None:
    def answer(question: Question) -> Answer:
        given = sequence_answer(0.5)
        for part in given.content["segments"] if question.plan.model == PAPER_MODEL else ():
            part.pop("diversity", None)
        return given

    shown = [
        table for table in section_of(SUITE, answer).all(Table) if "Diversity" in table.caption
    ]
    assert [table.part for table in shown] == [f"{ANY_MODEL}-diversity"]


def test_without_the_model_of_every_machine_the_paper_s_alone_is_shown() -> None:
    answered = [
        (question, sequence_answer(0.5))
        for question in SUITE.questions()
        if not question.if_covered
    ]
    found = SUITE.section(answered)
    assert len(errors_of(found)) == 1
    (picture,) = found.all(Picture)
    labels = picture.figure.axes[0].get_legend_handles_labels()[1]
    assert not any("every machine" in label for label in labels)


def test_the_same_answers_make_the_same_table() -> None:
    assert section(0.1, 0.2, 0.3).all(Table) == section(0.1, 0.2, 0.3).all(Table)


def test_every_setting_is_drawn_in_the_panel_of_its_k_and_nothing_else() -> None:
    def error(evaluations: int, k: int) -> float:
        return float(k * evaluations)

    def answer(question: Question) -> Answer:
        method, model = question.plan.method, question.plan.model
        assert isinstance(method, ActionDiffusion)
        assert model is not None
        k = question.plan.num_candidates
        return sequence_answer(error(Setting(method, model).evaluations, k))

    (picture,) = section_of(SUITE, answer).all(Picture)

    for axes, k in zip(picture.figure.axes, SUITE.size.budgets, strict=True):
        *lines, reference, star = axes.lines
        points = [tuple(xy) for line in lines for xy in np.asarray(line.get_xydata()).tolist()]
        assert sorted(points) == sorted(
            (setting.evaluations, error(setting.evaluations, k)) for setting in SETTINGS
        )
        assert set(np.asarray(reference.get_ydata())) == {error(100, k)}
        assert np.asarray(star.get_xydata()).tolist() == [[100, error(100, k)]]
