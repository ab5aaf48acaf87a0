"""How routes answer: within the deadline, and while the client waits."""

from contextlib import ExitStack
from functools import partial

from fastapi import Request
from fastapi.responses import Response

from app.api.body import JsonRoute
from app.api.dependencies import NOT_READY, get_runtime, problems
from app.api.sending import AnswerResponse, accepts_gzip
from app.serving.runtime import Answers, Runtime, T

PLAN_PROBLEMS = problems(
    (400, "The body is not JSON, not UTF-8, or nested too deeply."),
    (404, "No such model."),
    (413, "The body is too large."),
    (415, "The body is not sent as JSON, or it is compressed."),
    (422, "A field is invalid, repeated, too large, or does not fit the model."),
    (429, "Too much to do, or no time for it; Retry-After says when to come back."),
    (500, "Planning failed."),
    NOT_READY,
    (504, "The deadline has passed."),
)


class DeferrableRoute(JsonRoute):
    """A route whose requests wait their turn, and go unread where that takes too long."""

    async def _answer(self, request: Request) -> Response:
        await request.body()
        await (await get_runtime(request)).turns.take()
        return await super()._answer(request)


async def work_out(
    request: Request, runtime: Runtime, service: Answers[T], resolved: T
) -> Response:
    """Have it answered, within its deadline and while the client waits."""
    work = resolved.work
    request.state.log_fields |= resolved.log_fields
    is_gzip_accepted = accepts_gzip(",".join(request.headers.getlist("Accept-Encoding")))
    gone = partial(hung_up, request)
    with ExitStack() as until_sent:
        until_sent.enter_context(runtime.admission.answering(work))
        body, timing = await runtime.answer(
            service, resolved, accepts_gzip=is_gzip_accepted, gone=gone
        )
        work.answer_bytes = body.num_bytes
        request.state.log_fields |= {f"{stage}_ms": ms for stage, ms in timing.items()}
        header = ", ".join(f"{stage};dur={ms}" for stage, ms in timing.items())
        return AnswerResponse(body, {"Server-Timing": header}, until_sent.pop_all())


async def hung_up(request: Request) -> None:
    """Return when the client has hung up; its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
