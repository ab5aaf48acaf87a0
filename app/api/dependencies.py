"""What routes have in common: the parts behind them, and how their problems are documented."""

from typing import Annotated, Any

from fastapi import Depends, Request

from app.api.errors import MEDIA_TYPE
from app.serving.runtime import Runtime
from app.serving.service import PlanningService
from app.wire.problems import ProblemDetails

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
