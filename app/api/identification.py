"""The route that identifies a machine from a log of it."""

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.api.answering import PLAN_PROBLEMS, DeferrableRoute, work_out
from app.api.dependencies import get_runtime
from app.wire.identification import IdentifyRequest, IdentifyResponse
from app.wire.model import build_checks

IDENTIFY_PATH = "/identify"

build_checks()
router = APIRouter(
    route_class=DeferrableRoute, generate_unique_id_function=lambda route: route.name
)


@router.post(
    IDENTIFY_PATH, response_model=IdentifyResponse, responses=PLAN_PROBLEMS, tags=["identification"]
)
async def identify(body: IdentifyRequest, request: Request) -> Response:
    """Identify a machine from a log: its plant, how sure each parameter is, and an ensemble."""
    runtime = await get_runtime(request)
    service = runtime.identification
    resolved = service.resolve(body, request.state.arrived)
    return await work_out(request, runtime, service, resolved)
