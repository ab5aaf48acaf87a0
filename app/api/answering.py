"""How routes answer: worked out in a thread, within the deadline and while the client waits."""

from contextlib import ExitStack
from functools import partial
from typing import Any, Protocol, TypeVar

from fastapi import Request
from fastapi.responses import Response

from app.api.dependencies import NOT_READY, problems
from app.api.sending import AnswerResponse, Body, accepts_gzip, make_body
from app.serving.admission import Work
from app.serving.runtime import Runtime

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


class Resolved(Protocol):
    """A request with nothing left open."""

    @property
    def work(self) -> Work: ...

    @property
    def log_fields(self) -> dict[str, Any]: ...


T = TypeVar("T", bound=Resolved)
T_contra = TypeVar("T_contra", bound=Resolved, contravariant=True)


class Answers(Protocol[T_contra]):
    """What works out the answers to such requests."""

    def answer(self, resolved: T_contra, waited_ms: float) -> dict[str, Any]: ...


async def work_out(
    request: Request, runtime: Runtime, service: Answers[T], resolved: T
) -> Response:
    """Have it worked out in a thread, within its deadline and while the client waits."""
    work = resolved.work
    request.state.log_fields |= resolved.log_fields
    is_gzip_accepted = accepts_gzip(",".join(request.headers.getlist("Accept-Encoding")))

    def answer(waited_ms: float) -> tuple[Body, dict[str, float]]:
        result = service.answer(resolved, waited_ms)
        body = make_body(result, accepts_gzip=is_gzip_accepted, stop=work.stop)
        return body, result["timing_ms"]

    with ExitStack() as until_sent:
        until_sent.enter_context(runtime.admission.answering(work))
        body, timing = await runtime.workers.run(work, answer, partial(hung_up, request))
        work.answer_bytes = body.num_bytes
        request.state.log_fields |= {f"{stage}_ms": ms for stage, ms in timing.items()}
        header = ", ".join(f"{stage};dur={ms}" for stage, ms in timing.items())
        return AnswerResponse(body, {"Server-Timing": header}, until_sent.pop_all())


async def hung_up(request: Request) -> None:
    """Return when the client has hung up; its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
