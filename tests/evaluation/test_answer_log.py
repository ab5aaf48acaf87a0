"""The log of answers: nothing kept is lost, nothing broken is believed."""

import json
import lzma
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from app.evaluation.answer_log import Answer, AnswerLog, EvaluationError
from app.evaluation.question import Question, key_of
from app.planning.methods import CEM
from app.planning.plant.system import System
from app.wire.requests import PlanRequest
from tests.evaluation.fakes import question, session

QUESTIONS = [question(seed) for seed in range(3)]


def content(asked: Question) -> dict[str, Any]:
    """What the service sends, shortened."""
    return {"seed": asked.request.seed, "terminal_error": 0.1, "note": "\N{PLUS-MINUS SIGN}"}


def complete(log: AnswerLog) -> None:
    """Bring into the log what it lacks of a session and all the questions' answers."""
    if not log.sessions:
        log.begin(session())
    for asked in QUESTIONS:
        if asked not in log:
            log.append(asked, content(asked), 12.34567)


def assert_complete(log: AnswerLog) -> None:
    assert log.sessions == [session()]
    assert list(log.answered(QUESTIONS)) == [
        (asked, Answer(content(asked), 12.346)) for asked in QUESTIONS
    ]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The file of a complete log."""
    with AnswerLog(tmp_path) as log:
        complete(log)
    return tmp_path / "answers.jsonl"


def test_what_was_appended_is_there_after_reopening(path: Path) -> None:
    with AnswerLog(path.parent) as log:
        assert_complete(log)
        assert question(99) not in log


def test_every_answer_is_in_the_file_at_once(tmp_path: Path) -> None:
    with AnswerLog(tmp_path) as log:
        log.begin(session())
        for number, asked in enumerate(QUESTIONS, 2):
            log.append(asked, content(asked), 1.0)
            assert (tmp_path / "answers.jsonl").read_bytes().count(b"\n") == number


def test_what_no_model_covers_is_left_out_for_good_and_is_not_an_answer(tmp_path: Path) -> None:
    with AnswerLog(tmp_path) as log:
        log.begin(session())
        log.append(QUESTIONS[0], content(QUESTIONS[0]), 1.0)
        log.leave_out(QUESTIONS[1])
    for _ in range(2):
        with AnswerLog(tmp_path) as log:
            assert [asked in log for asked in QUESTIONS] == [True, True, False]
            assert [asked for asked, _ in log.answered(QUESTIONS)] == QUESTIONS[:1]
            log.pack()


def test_a_log_cut_anywhere_keeps_its_complete_lines_and_goes_on(path: Path) -> None:
    whole = path.read_bytes()
    last = whole.rindex(b"\n", 0, -1) + 1
    for length in (*range(0, last, 37), *range(last, len(whole))):
        path.write_bytes(whole[:length])
        lines = whole[:length].count(b"\n")
        with AnswerLog(path.parent) as log:
            kept = [asked for asked in QUESTIONS if asked in log]
            assert kept == QUESTIONS[: max(0, lines - 1)]
            assert len(log.sessions) == min(1, lines)
            complete(log)
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "damaged",
    [b"", b"garbage", b"\xff\xfe", b"3", b"null", b'"session"', b"[]", b"{}", b'{"session": {}}'],
)
def test_a_damaged_line_is_refused_by_its_number(path: Path, damaged: bytes) -> None:
    lines = path.read_bytes().split(b"\n")
    lines[2] = damaged
    path.write_bytes(b"\n".join(lines))
    for _ in range(2):
        with pytest.raises(EvaluationError, match=r"answers\.jsonl, line 3, is damaged"):
            AnswerLog(path.parent)
    assert path.read_bytes() == b"\n".join(lines)


def test_a_second_writer_is_refused(path: Path) -> None:
    with AnswerLog(path.parent) as log:
        with pytest.raises(EvaluationError, match="another evaluation is writing to"):
            AnswerLog(path.parent)
        log.pack()
    with AnswerLog(path.parent), pytest.raises(EvaluationError, match="another evaluation"):
        AnswerLog(path.parent)
    with AnswerLog(path.parent) as log:
        assert_complete(log)


def files(directory: Path) -> set[str]:
    return {file.name for file in directory.iterdir()}


def test_packing_and_unpacking_keep_everything(path: Path) -> None:
    written = path.read_bytes()
    for _ in range(2):
        with AnswerLog(path.parent) as log:
            log.pack()
        assert files(path.parent) == {"answers.jsonl.xz"}
    with AnswerLog(path.parent) as log:
        assert_complete(log)
        assert files(path.parent) == {"answers.jsonl"}
    assert path.read_bytes() == written


@pytest.mark.parametrize(
    "left",
    [
        {"answers.jsonl", "answers.jsonl.unfinished"},
        {"answers.jsonl", "answers.jsonl.xz"},
        {"answers.jsonl.xz", "answers.unfinished"},
    ],
    ids=["while it packed", "before it removed the other", "while it unpacked"],
)
def test_packing_and_unpacking_survive_a_kill(path: Path, left: set[str]) -> None:
    written = path.read_bytes()
    contents = {"answers.jsonl": written, "answers.jsonl.xz": lzma.compress(written)}
    path.unlink()
    for name in left:
        (path.parent / name).write_bytes(contents.get(name, b"a part"))
    with AnswerLog(path.parent) as log:
        assert_complete(log)
        log.pack()
    assert files(path.parent) == {"answers.jsonl.xz"}
    with AnswerLog(path.parent) as log:
        assert_complete(log)


@pytest.mark.parametrize("length", [0, 10, 100])
def test_a_damaged_packed_log_is_refused(path: Path, length: int) -> None:
    packed = path.with_suffix(".jsonl.xz")
    packed.write_bytes(lzma.compress(path.read_bytes())[:length] + b"x" * (length == 100))
    path.unlink()
    with pytest.raises(EvaluationError, match=r"answers\.jsonl\.xz is damaged"):
        AnswerLog(path.parent)
    assert packed.exists()


@contextmanager
def limited_to(size: int) -> Iterator[None]:
    """Let no file grow beyond `size`, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_said_and_costs_one_answer(path: Path) -> None:
    size = path.stat().st_size
    with AnswerLog(path.parent) as log, limited_to(size + 20):
        with pytest.raises(OSError, match="full"):
            log.append(question(99), content(question(99)), 1.0)
        assert question(99) not in log
    with AnswerLog(path.parent) as log:
        assert_complete(log)
    assert path.stat().st_size == size


@pytest.mark.parametrize(
    ("other", "names"),
    [
        ({"version": "2.0"}, ("version 1.2.3 with tiny/1 aaaaaaaaaaaa", "version 2.0 with tiny/1")),
        ({"model_sha256": "b" * 64}, ("tiny/1 aaaaaaaaaaaa", "tiny/1 bbbbbbbbbbbb")),
    ],
)
def test_another_service_is_refused_and_both_are_named(
    path: Path, other: dict[str, Any], names: tuple[str, str]
) -> None:
    with AnswerLog(path.parent) as log:
        with pytest.raises(EvaluationError, match="choose another folder") as refused:
            log.begin(session(**other))
        for name in names:
            assert name in str(refused.value)
        log.begin(session(concurrency=8))
    with AnswerLog(path.parent) as log:
        assert [begun.concurrency for begun in log.sessions] == [1, 8]


def test_a_service_with_more_models_goes_on(path: Path) -> None:
    more = session().model_copy(update={"models": {"another/1": "c" * 64}})
    both = session().model_copy(update={"models": {"tiny/1": "d" * 64, "another/1": "c" * 64}})
    with AnswerLog(path.parent) as log:
        log.begin(more)
    with (
        AnswerLog(path.parent) as log,
        pytest.raises(EvaluationError, match=r"tiny/1 dddd"),
    ):
        log.begin(both)


def test_the_latest_answer_counts(tmp_path: Path) -> None:
    model = {"name": "tiny", "version": "2", "sha256": "a" * 64}
    with AnswerLog(tmp_path) as log:
        log.begin(session())
        assert log.get(question(1)) is None
        log.append(question(1), {"terminal_error": 0.1}, 1.0)
        log.append(question(1), {"terminal_error": 0.2, "model": model}, 1.0)
    with AnswerLog(tmp_path) as log:
        answer = log.get(question(1))
        assert answer is not None
        assert (answer.content["terminal_error"], answer.model) == (0.2, "tiny/2")


def test_trajectories_are_kept_only_when_wanted(tmp_path: Path) -> None:
    wanted, unwanted = question(1, trajectories=True), question(1)
    assert wanted.key != unwanted.key
    plan = {"controls": [0.5], "states": [[0.0, 0.0]], "candidates": {}, "terminal_error": 0.1}
    with AnswerLog(tmp_path) as log:
        log.begin(session())
        for asked in (wanted, unwanted):
            log.append(asked, {**plan, "segments": [plan, plan]}, 1.0)
    with AnswerLog(tmp_path) as log:
        segments = [{"terminal_error": 0.1}] * 2
        kept = [answer.content for _, answer in log.answered([wanted, unwanted])]
        assert kept == [
            {**plan, "segments": segments},
            {"terminal_error": 0.1, "segments": segments},
        ]


def test_compute_time_is_the_service_s_own_without_waiting() -> None:
    timing = {"queue": 0.5, "propose": 1.0, "refine": 0.0, "rollout": 1.0, "total": 2.5}
    assert Answer({"timing_ms": timing}, 99.0).compute_ms == 2.0


def test_the_key_depends_neither_on_labels_nor_on_the_order_of_fields() -> None:
    asked = question(1)
    assert Question({"task": 99}, asked.request).key == asked.key
    assert question(2).key != asked.key
    body = json.loads(json.dumps(asked.body))
    shuffled = {name: body[name] for name in reversed(body)}
    shuffled["request"] = {name: body["request"][name] for name in reversed(body["request"])}
    assert list(shuffled) != list(body)
    assert key_of(shuffled) == asked.key


def test_the_key_stays_when_requests_gain_a_field() -> None:
    class LaterRequest(PlanRequest):
        weight: float = 1.0

    asked = question(1).request
    later = LaterRequest.model_validate(asked.model_dump())
    assert Question({}, later).key == Question({}, asked).key
    later.weight = 2.0
    assert Question({}, later).key != Question({}, asked).key


def test_of_a_plant_the_key_holds_what_is_not_nominal() -> None:
    request = question(1).plan
    request.system = System(static_friction=0.8)
    assert Question({}, request).body["request"]["system"] == {"static_friction": 0.8}


def test_a_method_stands_in_the_key_with_all_its_options() -> None:
    method = question(1, "cem").body["request"]["method"]
    assert method == asdict(CEM())
