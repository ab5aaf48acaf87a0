"""The routes: each reads a request, hands it on, and answers."""

import platform
from collections.abc import AsyncIterator
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from typing import Annotated, Any, Protocol, TypeVar

import numba
import numpy
from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import PlainTextResponse, Response
from llvmlite.binding import get_host_cpu_name

from app.api.body import JsonRoute
from app.api.errors import MEDIA_TYPE
from app.api.sending import AnswerResponse, Body, accepts_gzip, make_body
from app.inference.device import LIBRARY_VERSION, choose_device
from app.inference.model import Model
from app.inference.verification import ModelRejected
from app.planning.plant.system import System
from app.serving.admission import Work
from app.serving.kernels import available_cores
from app.serving.runtime import Runtime
from app.serving.service import PlanningService
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


def problems(*descriptions: tuple[int, str]) -> dict[int | str, dict[str, Any]]:
    """Document answers that are problem+json."""
    schema = {"$ref": f"#/components/schemas/{ProblemDetails.__name__}"}
    return {
        status: {"description": text, "content": {MEDIA_TYPE: {"schema": schema}}}
        for status, text in descriptions
    }


NOT_READY = (503, "The service is starting or draining.")
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


async def until_sent() -> AsyncIterator[ExitStack]:
    """What is entered here ends when the answer is sent, or will not be."""
    with ExitStack() as stack:
        yield stack


UntilSent = Annotated[ExitStack, Depends(until_sent)]


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
    return await work_out(request, runtime, service, resolved, until_sent)


@router.post(
    "/plan_multistep",
    response_model=MultistepPlanResponse,
    responses=PLAN_PROBLEMS,
    tags=["planning"],
)
async def plan_multistep(
    body: MultistepPlanRequest,
    request: Request,
    service: ServiceDependency,
    runtime: RuntimeDependency,
    until_sent: UntilSent,
) -> Response:
    """Plan to several targets, each from the state that the plan before it reached."""
    resolved = service.resolve(body, request.state.arrived)
    return await work_out(request, runtime, service, resolved, until_sent)


async def work_out(
    request: Request,
    runtime: Runtime,
    service: Answers[T],
    resolved: T,
    until_sent: ExitStack,
) -> Response:
    """Have it worked out in a thread, within its deadline and while the client waits."""
    work = resolved.work
    request.state.log_fields |= resolved.log_fields
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


async def _hung_up(request: Request) -> None:
    """Return when the client has hung up; its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


@router.get("/methods", tags=["about"])
async def methods() -> list[MethodDescription]:
    """List the planning methods with their options."""
    return describe_methods()


@router.get("/models", responses=problems(NOT_READY), tags=["about"])
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
    responses=problems(NOT_READY),
    dependencies=[Depends(get_service)],
    tags=["health"],
)
async def readyz() -> Health:
    """Say that plans can be made."""
    return Health(status="ready")


@router.get("/metrics", response_class=PlainTextResponse, tags=["health"])
async def metrics(request: Request, runtime: RuntimeDependency) -> Response:
    """Count and time all that was asked, in Prometheus' text format."""
    metrics = request.state.metrics
    body, content_type = metrics.render(runtime.pending, runtime.open_sessions)
    return Response(body, media_type=content_type)


@admin_router.post(
    "/admin/reload",
    responses=problems((409, "A model is not in order; those in use stay."), NOT_READY),
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
