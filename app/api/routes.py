"""The routes that tell of the service: what it is, whether it is well, what it counts."""

import platform
from importlib.metadata import version

import numba
import numpy
from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import PlainTextResponse, Response
from llvmlite.binding import get_host_cpu_name

from app.api.dependencies import (
    NOT_READY,
    RuntimeDependency,
    ServiceDependency,
    get_service,
    problems,
)
from app.inference.device import LIBRARY_VERSION, choose_device
from app.inference.model_card import ModelCard
from app.inference.verification import ModelRejected
from app.planning.plant.system import System
from app.serving.kernels import available_cores
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
from app.wire.batches import MAX_PROBLEMS
from app.wire.identification import MAX_SAMPLES
from app.wire.requests import MAX_PENDING_CONTROLS, MAX_TARGETS

router = APIRouter(generate_unique_id_function=lambda route: route.name)
admin_router = APIRouter()
"""Open only where the settings say so."""


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
        limits=Limits(
            max_targets=MAX_TARGETS,
            max_log_samples=MAX_SAMPLES,
            max_problems=MAX_PROBLEMS,
            max_pending_controls=MAX_PENDING_CONTROLS,
            **limits,
        ),
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


def _describe(model: ModelCard) -> ModelDescription:
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
        kind=manifest.kind,
        uncertainty=dict(manifest.uncertainty),
        predicts=manifest.predicts,
        samplers=manifest.samplers,
        diffusion_timesteps=len(manifest.alphas_cumprod),
        validation_loss=manifest.losses.validation,
    )
