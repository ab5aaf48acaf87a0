"""Ask a service what a log of answers lacks: a few questions at once, each answer kept at once."""

import asyncio
from collections.abc import Callable, Iterable
from http import HTTPStatus
from time import perf_counter
from typing import TypeAlias

from app.client.planner_client import AsyncPlannerClient, RequestRefused
from app.evaluation.answer_log import AnswerLog, EvaluationError
from app.evaluation.question import Question
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.identification import IdentifyRequest, IdentifyResponse
from app.wire.requests import MultistepPlanRequest
from app.wire.simulation import SimulateRequest, SimulateResponse

AnyResponse: TypeAlias = PlanResponse | MultistepPlanResponse | IdentifyResponse | SimulateResponse


async def ask_all(
    client: AsyncPlannerClient,
    questions: Iterable[Question],
    log: AnswerLog,
    concurrency: int,
    answered: Callable[[Question], None],
) -> None:
    """Ask `questions`, at most `concurrency` at once, and append the answers to `log`.

    Args:
        client: the service.
        questions: taken in order.
        log: takes each answer as it arrives; it has begun.
        concurrency: most requests under way at once.
        answered: told of each question once its answer is kept.

    Raises:
        RequestRefused: the service says no, and not because nothing follows from a log.
        EvaluationError: it answers with another model than it listed.
        httpx.TransportError: it cannot be reached.
    """
    waiting = iter(questions)

    async def work() -> None:
        for question in waiting:
            started = perf_counter()
            try:
                answer = await ask(client, question)
            except RequestRefused as refusal:
                if not _tells_nothing(question, refusal):
                    raise
                log.leave_out(question)
                answered(question)
                continue
            latency_ms = (perf_counter() - started) * 1e3
            _check_model(answer, log)
            content = answer.model_dump(mode="json", exclude_none=True)
            log.append(question, content, latency_ms)
            answered(question)

    try:
        async with asyncio.TaskGroup() as workers:
            for _ in range(concurrency):
                workers.create_task(work())
    except* Exception as group:
        first: BaseException = group
        while isinstance(first, BaseExceptionGroup):
            first = first.exceptions[0]
        raise first from None


async def ask(client: AsyncPlannerClient, question: Question) -> AnyResponse:
    """Ask one question; errors as for `AsyncPlannerClient.plan`."""
    request = question.request
    if isinstance(request, IdentifyRequest):
        return await client.identify(request)
    if isinstance(request, MultistepPlanRequest):
        return await client.plan_multistep(request)
    if isinstance(request, SimulateRequest):
        return await client.simulate(request)
    return await client.plan(request)


def _tells_nothing(question: Question, refusal: RequestRefused) -> bool:
    """Say whether it is a log from which nothing follows: that is an answer, too."""
    is_unprocessable = refusal.problem.status == HTTPStatus.UNPROCESSABLE_ENTITY
    return isinstance(question.request, IdentifyRequest) and is_unprocessable


def _check_model(answer: AnyResponse, log: AnswerLog) -> None:
    """Make sure that a service that was restarted meanwhile is still the same."""
    if isinstance(answer, IdentifyResponse | SimulateResponse) or answer.model is None:
        return
    name = f"{answer.model.name}/{answer.model.version}"
    if log.sessions[-1].models.get(name) != answer.model.sha256:
        raise EvaluationError(f"the service has changed: it now answers with another {name}")
