"""The routes: each reads a request, hands it on, and answers."""

import platform
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from typing import Annotated, Any

import numba
import numpy
from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import PlainTextResponse, Response
from llvmlite.binding import get_host_cpu_name

from app.api.body import JsonRoute
from app.api.errors import MEDIA_TYPE, tell
from app.api.events import EVENT_STREAM, accepts_events, as_event, json_event, stream
from app.api.sending import AnswerResponse, Body, accepts_gzip, make_body
from app.inference.device import LIBRARY_VERSION, choose_device
from app.inference.model import Model
from app.inference.verification import ModelRejected
from app.planning.plant.system import System
from app.serving.kernels import available_cores
from app.serving.runtime import Runtime
from app.serving.service import PlanningService, ResolvedRequest
from app.wire.about import (
    Health,
    Info,
    Limits,
    MachineDescription,
    MethodDescription,
    ModelDescription,
    describe_machines,
    describe_methods,
)
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.model import build_checks
from app.wire.problems import ProblemDetails
from app.wire.requests import (
    MAX_PENDING_CONTROLS,
    MAX_TARGETS,
    MultistepPlanRequest,
    PlanRequest,
)

build_checks()
router = APIRouter(route_class=JsonRoute, generate_unique_id_function=lambda route: route.name)
admin_router = APIRouter()
"""Open only where the settings say so."""

# Dependencies are coroutines: plain functions would each take a trip through a thread.


async def get_runtime(request: Request) -> Runtime:
    """Return what the lifespan set up."""
    runtime = request.state.runtime
    assert isinstance(runtime, Runtime)
    return runtime


RuntimeDependency = Annotated[Runtime, Depends(get_runtime)]


async def get_service(runtime: RuntimeDependency) -> PlanningService:
    """Return the planning service, once it is ready."""
    return runtime.service


ServiceDependency = Annotated[PlanningService, Depends(get_service)]


def _problems(*descriptions: tuple[int, str]) -> dict[int | str, dict[str, Any]]:
    """Document answers that are problem+json."""
    schema = {"$ref": f"#/components/schemas/{ProblemDetails.__name__}"}
    return {
        status: {"description": text, "content": {MEDIA_TYPE: {"schema": schema}}}
        for status, text in descriptions
    }


NOT_READY = (503, "The service is starting or draining.")
PLAN_PROBLEMS = _problems(
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


EVENTS: dict[int | str, dict[str, Any]] = {
    200: {"content": {EVENT_STREAM: {"schema": {"type": "string"}}}}
}


async def until_sent() -> AsyncIterator[ExitStack]:
    """What is entered here ends when the answer is sent, or will not be."""
    with ExitStack() as stack:
        yield stack


UntilSent = Annotated[ExitStack, Depends(until_sent)]


@router.post("/plan", response_model=PlanResponse, responses=PLAN_PROBLEMS, tags=["planning"])
async def plan(
    body: PlanRequest,
    request: Request,
    service: ServiceDependency,
    runtime: RuntimeDependency,
    until_sent: UntilSent,
) -> Response:
    """Plan a control sequence from a start to a target."""
    resolved = service.resolve(body, request.state.arrived)
    return await _answer(request, runtime, service, resolved, until_sent)


@router.post(
    "/plan_multistep",
    response_model=MultistepPlanResponse,
    responses=PLAN_PROBLEMS | EVENTS,
    tags=["planning"],
)
async def plan_multistep(
    body: MultistepPlanRequest,
    request: Request,
    service: ServiceDependency,
    runtime: RuntimeDependency,
    until_sent: UntilSent,
) -> Response:
    """Plan to several targets, each from the state that the plan before it reached.

    With `Accept: text/event-stream` the answer is events: `segment` for each as soon as it is
    planned, then `plan` with the whole; or `problem`, where something goes wrong after the first.
    """
    resolved = service.resolve(body, request.state.arrived)
    if accepts_events(request.headers):
        return await _stream(request, runtime, service, resolved, until_sent)
    return await _answer(request, runtime, service, resolved, until_sent)


async def _answer(
    request: Request,
    runtime: Runtime,
    service: PlanningService,
    resolved: ResolvedRequest[Any],
    until_sent: ExitStack,
) -> Response:
    """Have it planned in a thread, within its deadline and while the client waits."""
    work = resolved.work
    _log_resolved(request, resolved)
    is_gzip_accepted = accepts_gzip(",".join(request.headers.getlist("Accept-Encoding")))

    def answer(waited_ms: float) -> tuple[Body, dict[str, float]]:
        result = service.answer(resolved, waited_ms)
        body = make_body(result, accepts_gzip=is_gzip_accepted, stop=work.stop)
        return body, result["timing_ms"]

    until_sent.enter_context(runtime.admission.answering(work))
    body, timing = await runtime.workers.run(work, answer, partial(_hung_up, request))
    work.answer_bytes = body.num_bytes
    request.state.log_fields |= {f"{stage}_ms": ms for stage, ms in timing.items()}
    header = ", ".join(f"{stage};dur={ms}" for stage, ms in timing.items())
    return AnswerResponse(body, {"Server-Timing": header})


async def _stream(
    request: Request,
    runtime: Runtime,
    service: PlanningService,
    resolved: ResolvedRequest[Any],
    until_sent: ExitStack,
) -> Response:
    """Do as `_answer` does, with an event for each segment as soon as it is planned."""
    work = resolved.work
    _log_resolved(request, resolved)
    work.answer_bytes *= 2  # the segments, and once more in the whole
    until_sent.enter_context(runtime.admission.answering(work))

    async def run(put: Callable[[bytes], None]) -> bytes:
        def answer(waited_ms: float) -> tuple[bytes, dict[str, float]]:
            result = service.answer(
                resolved, waited_ms, lambda segment: put(json_event("segment", segment))
            )
            return json_event("plan", result), result["timing_ms"]

        event, timing = await runtime.workers.run(work, answer, partial(_hung_up, request))
        request.state.log_fields |= {f"{stage}_ms": ms for stage, ms in timing.items()}
        return event

    async def problem(error: Exception) -> bytes:
        told = await tell(request, error)
        return as_event("problem", bytes(told.body))

    return await stream(run, problem)


def _log_resolved(request: Request, resolved: ResolvedRequest[Any]) -> None:
    fields = request.state.log_fields
    fields |= {
        "method": resolved.recipe.method.name,
        "num_candidates": resolved.request.num_candidates,
        "num_targets": resolved.num_targets,
        "seed": resolved.seed,
    }
    if resolved.work.model:
        fields["model"] = resolved.work.model.label


async def _hung_up(request: Request) -> None:
    """Return when the client has hung up; its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


@router.get("/methods", tags=["about"])
async def methods() -> list[MethodDescription]:
    """List the planning methods with their options."""
    return describe_methods()


@router.get("/models", responses=_problems(NOT_READY), tags=["about"])
async def models(service: ServiceDependency) -> list[ModelDescription]:
    """List the models that plans can be made with."""
    return [_describe(model) for model in service.models.models]


@router.get("/machines", response_model_exclude_none=True, tags=["about"])
async def machines() -> list[MachineDescription]:
    """List the machines that may be planned for by name."""
    return describe_machines()


@router.get("/info", response_model_exclude_none=True, tags=["about"])
async def info(runtime: RuntimeDependency) -> Info:
    """Say what runs here, and what it allows."""
    limits = runtime.settings.model_dump(include=set(Limits.model_fields))
    return Info(
        name="breakaway",
        version=version("breakaway"),
        machine=f"{platform.platform()}, {get_host_cpu_name()}, {available_cores()} cores",
        device=choose_device().type,
        network_threads=runtime.network_threads,
        libraries={
            "python": platform.python_version(),
            "torch": LIBRARY_VERSION,
            "numpy": numpy.__version__,
            "numba": numba.__version__,
        },
        nominal_system=System(),
        limits=Limits(max_targets=MAX_TARGETS, max_pending_controls=MAX_PENDING_CONTROLS, **limits),
    )


@router.get("/livez", tags=["health"])
async def livez() -> Health:
    """Say that the process answers."""
    return Health(status="alive")


@router.get(
    "/readyz",
    responses=_problems(NOT_READY),
    dependencies=[Depends(get_service)],
    tags=["health"],
)
async def readyz() -> Health:
    """Say that plans can be made."""
    return Health(status="ready")


@router.get("/metrics", response_class=PlainTextResponse, tags=["health"])
async def metrics(request: Request, runtime: RuntimeDependency) -> Response:
    """Count and time all that was asked, in Prometheus' text format."""
    body, content_type = request.state.metrics.render(runtime.pending)
    return Response(body, media_type=content_type)


@admin_router.post(
    "/admin/reload",
    responses=_problems((409, "A model is not in order; those in use stay."), NOT_READY),
    tags=["admin"],
)
async def reload(runtime: RuntimeDependency) -> list[ModelDescription]:
    """Load what is new in the model store, put it in place of the old, and list the models."""
    try:
        await runtime.load()
    except ModelRejected as error:
        raise HTTPException(409, f"the old models stay: {error}") from error
    return await models(runtime.service)


def _describe(model: Model) -> ModelDescription:
    manifest = model.manifest
    return ModelDescription(
        name=manifest.name,
        version=str(manifest.version),
        sha256=manifest.sha256,
        trained_on=manifest.trained_on,
        plants=str(manifest.coverage),
        coverage=manifest.coverage,
        system=manifest.system,
        horizon=manifest.horizon,
        predicts=manifest.predicts,
        samplers=manifest.samplers,
        diffusion_timesteps=len(manifest.alphas_cumprod),
        validation_loss=manifest.losses.validation,
    )
