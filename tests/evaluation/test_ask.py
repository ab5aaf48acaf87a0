"""Asking: each question once, only so many at a time, and every answer kept at once."""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx
import pytest

from app.client.planner_client import AsyncPlannerClient, RequestRefused
from app.evaluation.answer_log import AnswerLog, EvaluationError
from app.evaluation.ask import ask_all
from app.evaluation.question import Question
from app.wire.identification import IdentifyRequest
from app.wire.requests import PlanRequest
from tests.evaluation.fakes import answer_to, question, session

Handle = Callable[[PlanRequest], Awaitable[httpx.Response]]

QUESTIONS = [question(seed) for seed in range(12)]


def ask_fake(
    handle: Handle,
    directory: Path,
    questions: list[Question] = QUESTIONS,
    concurrency: int = 1,
    answered: Callable[[Question], None] = lambda _: None,
) -> None:
    """Ask a service whose answers `handle` makes, and keep them in `directory`."""

    async def carry(request: httpx.Request) -> httpx.Response:
        if request.url.path == "/identify":
            return httpx.Response(422, text="nothing follows")
        return await handle(PlanRequest.model_validate_json(request.content))

    async def ask() -> None:
        transport = httpx.MockTransport(carry)
        async with AsyncPlannerClient("http://nowhere", transport=transport) as client:
            with AnswerLog(directory) as log:
                log.begin(session())
                await ask_all(client, questions, log, concurrency, answered)

    asyncio.run(ask())


def good(request: PlanRequest) -> httpx.Response:
    return httpx.Response(200, text=answer_to(request).model_dump_json())


def kept(directory: Path, questions: list[Question] = QUESTIONS) -> list[int | None]:
    with AnswerLog(directory) as log:
        return [asked.request.seed for asked in questions if asked in log]


@pytest.mark.parametrize("concurrency", [1, 3, 50])
def test_every_question_is_asked_once_and_only_so_many_at_a_time(
    tmp_path: Path, concurrency: int
) -> None:
    asked: Counter[int | None] = Counter()
    told: list[Question] = []
    under_way = [0]
    many = asyncio.Event()

    async def handle(request: PlanRequest) -> httpx.Response:
        asked[request.seed] += 1
        under_way.append(under_way[-1] + 1)
        if under_way[-1] == min(concurrency, 12):
            many.set()
        await many.wait()
        await asyncio.sleep(0)  # lets in who may not come in
        under_way.append(under_way[-1] - 1)
        return good(request)

    ask_fake(handle, tmp_path, concurrency=concurrency, answered=told.append)
    assert asked == Counter(range(12))
    assert max(under_way) == min(concurrency, 12)
    assert sorted(told, key=QUESTIONS.index) == QUESTIONS
    assert kept(tmp_path) == list(range(12))


def test_an_answer_is_kept_before_anyone_is_told(tmp_path: Path) -> None:
    async def handle(request: PlanRequest) -> httpx.Response:
        return good(request)

    def answered(asked: Question) -> None:
        lines = (tmp_path / "answers.jsonl").read_bytes().splitlines()
        assert len(lines) == 2 + QUESTIONS.index(asked)

    ask_fake(handle, tmp_path, answered=answered)


def test_a_refusal_ends_it_and_keeps_the_answers_before_it(tmp_path: Path) -> None:
    asked = []

    async def handle(request: PlanRequest) -> httpx.Response:
        asked.append(request.seed)
        return httpx.Response(422, text="no") if request.seed == 5 else good(request)

    with pytest.raises(RequestRefused, match="422"):
        ask_fake(handle, tmp_path)
    assert asked == list(range(6))
    assert kept(tmp_path) == list(range(5))


def test_that_nothing_follows_from_a_log_is_no_end(tmp_path: Path) -> None:
    async def handle(request: PlanRequest) -> httpx.Response:
        return good(request)

    log = IdentifyRequest(time_step=0.1, controls=[0.0] * 50, positions=[0.0] * 51, seed=3)
    untold = Question({}, log)
    told: list[Question] = []
    asked = [QUESTIONS[0], untold, QUESTIONS[1]]

    ask_fake(handle, tmp_path, questions=asked, answered=told.append)

    assert told == asked
    assert kept(tmp_path, asked) == [0, 3, 1]
    with AnswerLog(tmp_path) as answers:
        assert answers.get(untold) is None


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (httpx.Response(422, text="no"), RequestRefused),
        (httpx.ReadTimeout("too slow"), httpx.ReadTimeout),
    ],
)
def test_of_errors_at_the_same_time_one_is_raised_as_it_is(
    tmp_path: Path, answer: httpx.Response | Exception, error: type[Exception]
) -> None:
    async def handle(_: PlanRequest) -> httpx.Response:
        if isinstance(answer, Exception):
            raise answer
        return answer

    with pytest.raises(error):
        ask_fake(handle, tmp_path, concurrency=4)
    assert kept(tmp_path) == []


def test_an_answer_with_another_model_ends_it_and_is_not_kept(tmp_path: Path) -> None:
    questions = [question(seed, "action_diffusion") for seed in range(4)]

    async def handle(request: PlanRequest) -> httpx.Response:
        sha256 = ("a" if request.seed in (0, 1) else "b") * 64
        return httpx.Response(200, text=answer_to(request, sha256).model_dump_json())

    with pytest.raises(EvaluationError, match=r"the service has changed: .* another tiny/1"):
        ask_fake(handle, tmp_path, questions)
    assert kept(tmp_path, questions) == [0, 1]
