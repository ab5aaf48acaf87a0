"""The application: wiring and lifespan, nothing else."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Any

from fastapi import FastAPI
from fastapi_offline import FastAPIOffline

from app.api.errors import install_error_handlers
from app.api.middleware import BodyLimit
from app.api.routes import router
from app.api.runtime import Runtime
from app.settings import Settings


def create_app(settings: Settings) -> FastAPI:
    """Return the service; it starts to load its models when its lifespan begins."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[dict[str, Any]]:
        runtime = Runtime(settings)
        start = asyncio.create_task(runtime.start())
        yield {"runtime": runtime}
        await start
        runtime.stop()

    app = FastAPIOffline(
        title="Breakaway",
        summary="Open-loop control through dry friction and stiction.",
        version=version("breakaway"),
        lifespan=lifespan,
        redoc_url=None,
    )
    install_error_handlers(app)
    app.add_middleware(BodyLimit, max_bytes=settings.max_body_bytes)
    app.include_router(router)
    return app
