"""The routes of closed loops: whole runs, and a single step; sessions are in control_socket.py."""

from http import HTTPStatus

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.api.answering import PLAN_PROBLEMS, work_out
from app.api.body import JsonRoute
from app.api.dependencies import get_runtime
from app.wire.control import ControlRequest, ControlResponse
from app.wire.model import build_checks
from app.wire.simulation import SimulateRequest, SimulateResponse

CONTROL_PROBLEMS = dict(PLAN_PROBLEMS)
del CONTROL_PROBLEMS[HTTPStatus.NOT_FOUND]  # no model is asked for

build_checks()
router = APIRouter(route_class=JsonRoute, generate_unique_id_function=lambda route: route.name)


@router.post(
    "/simulate", response_model=SimulateResponse, responses=CONTROL_PROBLEMS, tags=["control"]
)
async def simulate(body: SimulateRequest, request: Request) -> Response:
    """Run a controller or a control sequence on a true plant, once for each of many seeds."""
    runtime = await get_runtime(request)
    service = runtime.simulation
    resolved = service.resolve(body, request.state.arrived)
    return await work_out(request, runtime, service, resolved)


@router.post(
    "/control", response_model=ControlResponse, responses=CONTROL_PROBLEMS, tags=["control"]
)
async def control(body: ControlRequest, request: Request) -> Response:
    """Do one step of a closed loop; the client carries what the next one needs."""
    runtime = await get_runtime(request)
    service = runtime.control
    resolved = service.resolve(body, request.state.arrived)
    return await work_out(request, runtime, service, resolved)
