"""The routes that plan: one plan, several targets, or many problems."""

import logging
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.api.answering import PLAN_PROBLEMS, DeferrableRoute, hung_up, work_out
from app.api.batch_response import NDJSON, BatchResponse
from app.api.dependencies import get_runtime
from app.api.errors import problem_of
from app.api.events import EVENT_STREAM, accepts_events, as_event, stream
from app.serving.runtime import Runtime
from app.serving.service import ResolvedRequest
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.batches import PlanBatchRequest
from app.wire.model import build_checks
from app.wire.requests import MultistepPlanRequest, PlanRequest

log = logging.getLogger(__name__)

BATCH_PATH = "/plan_batch"
EVENTS: dict[int | str, dict[str, Any]] = {
    200: {"content": {EVENT_STREAM: {"schema": {"type": "string"}}}}
}

build_checks()
router = APIRouter(
    route_class=DeferrableRoute, generate_unique_id_function=lambda route: route.name
)


@router.post("/plan", response_model=PlanResponse, responses=PLAN_PROBLEMS, tags=["planning"])
async def plan(body: PlanRequest, request: Request) -> Response:
    """Plan a control sequence from a start to a target."""
    runtime = await get_runtime(request)
    service = runtime.service
    resolved = service.resolve(body, request.state.arrived)
    return await work_out(request, runtime, service, resolved)


@router.post(
    "/plan_multistep",
    response_model=MultistepPlanResponse,
    responses=PLAN_PROBLEMS | EVENTS,
    tags=["planning"],
)
async def plan_multistep(body: MultistepPlanRequest, request: Request) -> Response:
    """Plan to several targets, each from the state that the plan before it reached.

    With `Accept: text/event-stream` the answer is events: `segment` for each as soon as it is
    planned, then `plan` with the whole; or `problem`, where something goes wrong after the first.
    """
    runtime = await get_runtime(request)
    service = runtime.service
    resolved = service.resolve(body, request.state.arrived)
    if accepts_events(request.headers):
        return await _stream(request, runtime, resolved)
    return await work_out(request, runtime, service, resolved)


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
    request.state.log_fields |= batch.log_fields
    describe = partial(problem_of, path=request.url.path)

    with ExitStack() as stack:
        stack.enter_context(runtime.admission.answering(work))
        stack.enter_context(runtime.admission.admitted(work))
        parts = runtime.answer_batch(batch, describe, partial(hung_up, request))
        return BatchResponse(batch, parts, stack.pop_all())


async def _stream(
    request: Request, runtime: Runtime, resolved: ResolvedRequest[MultistepPlanRequest]
) -> Response:
    """Do as `work_out` does, with an event for each segment as soon as it is planned."""
    work = resolved.work
    request.state.log_fields |= resolved.log_fields
    work.answer_bytes *= 2  # the segments, and once more in the whole

    async def run(put: Callable[[bytes], None]) -> bytes:
        def tell(segment: bytes) -> None:
            put(as_event("segment", segment))

        gone = partial(hung_up, request)
        body, timing = await runtime.answer_in_segments(resolved, tell, gone)
        request.state.log_fields |= {f"{stage}_ms": ms for stage, ms in timing.items()}
        return as_event("plan", b"".join(body.parts))

    def problem(error: Exception) -> bytes:
        told = problem_of(error, request.url.path)
        if told.status == HTTPStatus.INTERNAL_SERVER_ERROR:
            log.error("an error while a plan was streamed", exc_info=error)
        return as_event("problem", told.model_dump_json(exclude_none=True).encode())

    with ExitStack() as until_sent:
        until_sent.enter_context(runtime.admission.answering(work))
        return await stream(run, problem, until_sent)
