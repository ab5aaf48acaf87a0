"""The routes that plan: one plan, several targets, or many problems."""

from contextlib import ExitStack
from functools import partial

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.api.answering import PLAN_PROBLEMS, hung_up, work_out
from app.api.batch_response import NDJSON, BatchResponse
from app.api.body import JsonRoute
from app.api.dependencies import get_runtime
from app.api.errors import problem_of
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.batches import PlanBatchRequest
from app.wire.model import build_checks
from app.wire.requests import MultistepPlanRequest, PlanRequest

BATCH_PATH = "/plan_batch"
build_checks()
router = APIRouter(route_class=JsonRoute, generate_unique_id_function=lambda route: route.name)


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
    responses=PLAN_PROBLEMS,
    tags=["planning"],
)
async def plan_multistep(body: MultistepPlanRequest, request: Request) -> Response:
    """Plan to several targets, each from the state that the plan before it reached."""
    runtime = await get_runtime(request)
    service = runtime.service
    resolved = service.resolve(body, request.state.arrived)
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

    def answer(part: range, waited_ms: float) -> list[bytes]:
        return batch.answer(part, waited_ms, describe)

    with ExitStack() as stack:
        stack.enter_context(runtime.admission.answering(work))
        stack.enter_context(runtime.admission.admitted(work))
        parts = runtime.workers.run_parts(
            work, batch.parts(), answer, batch.parts_at_once, partial(hung_up, request)
        )
        return BatchResponse(batch, parts, stack.pop_all())
