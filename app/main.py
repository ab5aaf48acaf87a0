"""The application: wiring and lifespan, nothing else."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib.metadata import version
from typing import Any, TypeAlias

from asgi_correlation_id import CorrelationIdMiddleware
from fastapi import FastAPI
from fastapi_offline import FastAPIOffline
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware

from app.api import control_socket
from app.api.control_routes import router as control_router
from app.api.documentation import add_pages, document_middleware
from app.api.errors import install_error_handlers
from app.api.identification import IDENTIFY_PATH
from app.api.identification import router as identification_router
from app.api.keys import ApiKeys, read_keys
from app.api.metrics import Metrics
from app.api.middleware import BodyLimit, HeadAsGet
from app.api.planning import BATCH_PATH
from app.api.planning import router as planning_router
from app.api.playground import add_playground
from app.api.request_target import RequestTarget
from app.api.routes import admin_router, router
from app.api.telemetry import Telemetry, is_request_id
from app.api.unsupported import Unsupported
from app.inference.engine import Tick, Watch
from app.serving.local_runtime import LocalRuntime
from app.serving.runtime import Runtime
from app.settings import Settings

MakeRuntime: TypeAlias = Callable[[Settings, Watch], Runtime]


def create_app(settings: Settings, make_runtime: MakeRuntime = LocalRuntime) -> FastAPI:
    """Return the service; it starts to load its models when its lifespan begins.

    Args:
        settings: of the service.
        make_runtime: makes what works out the answers; it tells what it is given of every batch
            that goes through a network here.

    Raises:
        KeysRejected: the API keys that the settings name cannot be used.
    """
    metrics = Metrics()
    keys = read_keys(settings)

    def watch(tick: Tick) -> None:
        metrics.observe_tick(tick.model.label, tick.rows, tick.seconds)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[dict[str, Any]]:
        runtime = make_runtime(settings, watch)
        start = asyncio.create_task(runtime.start())
        yield {"runtime": runtime, "metrics": metrics}
        await runtime.drain()
        start.cancel()
        with suppress(asyncio.CancelledError):
            await start
        runtime.close()

    app = FastAPIOffline(
        title="Breakaway",
        summary="Open-loop control through dry friction and stiction.",
        version=version("breakaway"),
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # to an address that only a proxy's client could know
        middleware=_middleware(settings, metrics, keys),
    )
    install_error_handlers(app)
    # The routes themselves: an included router would look for each anew, at every request.
    for routed in (planning_router, identification_router, control_router, router):
        app.router.routes += routed.routes
    app.router.routes.append(control_socket.route)
    if settings.admin:
        app.router.routes += admin_router.routes
    add_pages(app)
    add_playground(app)
    document_middleware(app, settings.public_paths if keys else None)
    return app


def _middleware(settings: Settings, metrics: Metrics, keys: list[bytes]) -> list[Middleware]:
    """Return what each request passes on its way to the routes, from the outside in."""
    passed = [
        Middleware(RequestTarget, root_path=settings.root_path),
        Middleware(CorrelationIdMiddleware, validator=is_request_id),
        Middleware(Telemetry, metrics=metrics),
        Middleware(Unsupported, origins=settings.cors_origins),
    ]
    if settings.cors_origins:  # outside the keys: a browser's preflight brings none
        passed.append(
            Middleware(
                CORSMiddleware,
                allow_origins=settings.cors_origins,
                allow_methods=["GET", "POST"],
                allow_headers=["Authorization", "Content-Type", "X-Request-ID"],
                expose_headers=["X-Request-ID", "Server-Timing", "Retry-After"],
            )
        )
    if keys:
        passed.append(Middleware(ApiKeys, digests=keys, public_paths=settings.public_paths))
    return [
        *passed,
        Middleware(HeadAsGet),
        Middleware(
            BodyLimit,
            max_bytes=settings.max_body_bytes,
            timeout_s=settings.body_timeout_s,
            larger={
                IDENTIFY_PATH: settings.max_log_bytes,
                BATCH_PATH: settings.max_batch_body_bytes,
            },
        ),
    ]
