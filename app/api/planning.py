"""The routes that plan: one plan, several targets, or many problems."""

from contextlib import ExitStack
from functools import partial
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.api.batch_response import NDJSON, BatchResponse
from app.api.body import JsonRoute
from app.api.dependencies import NOT_READY, get_runtime, problems
from app.api.errors import problem_of
from app.api.sending import AnswerResponse, Body, accepts_gzip, make_body
from app.serving.runtime import Runtime
from app.serving.service import PlanningService, ResolvedRequest
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.batches import PlanBatchRequest
from app.wire.model import build_checks
from app.wire.requests import MultistepPlanRequest, PlanRequest

BATCH_PATH = "/plan_batch"
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

build_checks()
router = APIRouter(route_class=JsonRoute, generate_unique_id_function=lambda route: route.name)


@router.post("/plan", response_model=PlanResponse, responses=PLAN_PROBLEMS, tags=["planning"])
async def plan(body: PlanRequest, request: Request) -> Response:
    """Plan a control sequence from a start to a target."""
    runtime = await get_runtime(request)
    service = runtime.service
    resolved = service.resolve(body, request.state.arrived)
    return await _answer(request, runtime, service, resolved)


@router.post(
    "/plan_multistep",
    response_model=MultistepPlanResponse,
    responses=PLAN_PROBLEMS,
    tags=["planning"],
)
async def plan_multistep(body: MultistepPlanRequest, request: Request) -> Response:
    """Plan to several targets, each from the state that the plan before it reached."""
    runtime = await get_runtime(request)
    service = runtime.service
    resolved = service.resolve(body, request.state.arrived)
    return await _answer(request, runtime, service, resolved)


@router.post(
    BATCH_PATH,
    status_code=200,
    response_class=BatchResponse,
    responses={
        200: {
            "description": "A line of JSON for each problem: a BatchPlan, or a BatchFailure, "
            "which says why there is none.",
            "content": {NDJSON: {"schema": {"type": "string"}}},
        },
        **{code: told for code, told in PLAN_PROBLEMS.items() if code not in (500, 504)},
    },
    tags=["planning"],
)
async def plan_batch(body: PlanBatchRequest, request: Request) -> Response:
    """Plan for many problems; a line of JSON for each of them, in the order in which they are done.

    What they share stands once. The answer comes as fast as it is read, and no faster.
    """
    runtime = await get_runtime(request)
    batch = runtime.batch(body, request.state.arrived)
    work = batch.work
    _log(request, batch.stand_in, num_problems=len(body.problems))
    describe = partial(problem_of, path=request.url.path)

    def answer(part: range, waited_ms: float) -> list[bytes]:
        return batch.answer(part, waited_ms, describe)

    with ExitStack() as stack:
        stack.enter_context(runtime.admission.answering(work))
        stack.enter_context(runtime.admission.admitted(work))
        parts = runtime.workers.run_parts(
            work, batch.parts(), answer, batch.parts_at_once, partial(_hung_up, request)
        )
        return BatchResponse(batch, parts, stack.pop_all())


async def _answer(
    request: Request, runtime: Runtime, service: PlanningService, resolved: ResolvedRequest[Any]
) -> Response:
    """Have it planned in a thread, within its deadline and while the client waits."""
    work = resolved.work
    _log(request, resolved, num_targets=resolved.num_targets)
    is_gzip_accepted = accepts_gzip(",".join(request.headers.getlist("Accept-Encoding")))

    def answer(waited_ms: float) -> tuple[Body, dict[str, float]]:
        result = service.answer(resolved, waited_ms)
        body = make_body(result, accepts_gzip=is_gzip_accepted, stop=work.stop)
        return body, result["timing_ms"]

    with ExitStack() as until_sent:
        until_sent.enter_context(runtime.admission.answering(work))
        body, timing = await runtime.workers.run(work, answer, partial(_hung_up, request))
        work.answer_bytes = body.num_bytes
        request.state.log_fields |= {f"{stage}_ms": ms for stage, ms in timing.items()}
        header = ", ".join(f"{stage};dur={ms}" for stage, ms in timing.items())
        return AnswerResponse(body, {"Server-Timing": header}, until_sent.pop_all())


def _log(request: Request, resolved: ResolvedRequest[Any], **fields: int) -> None:
    """Put what is planned into the request's log line."""
    request.state.log_fields |= {
        "method": resolved.recipe.method.name,
        "num_candidates": resolved.request.num_candidates,
        **fields,
        "seed": resolved.seed,
    }
    if resolved.model:
        request.state.log_fields["model"] = resolved.model.label


async def _hung_up(request: Request) -> None:
    """Return when the client has hung up; its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
