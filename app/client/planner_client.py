"""An asynchronous client of the service, with typed answers from the very schemas it uses."""

import asyncio
from typing import TypeVar

import httpx
from pydantic import BaseModel

from app.api.schemas import (
    MultistepPlanRequest,
    MultistepPlanResponse,
    PlanRequest,
    PlanResponse,
)

Answer = TypeVar("Answer", bound=BaseModel)


class PlannerClient:
    """Asks a service for plans, a few at a time.

    Args:
        http: where the service is.
        concurrency: most requests under way at once.
    """

    def __init__(self, http: httpx.AsyncClient, concurrency: int = 2) -> None:
        self._http = http
        self._slots = asyncio.Semaphore(concurrency)

    async def plan(self, request: PlanRequest) -> PlanResponse:
        """Ask `POST /plan`.

        Raises:
            httpx.HTTPError: the service cannot be reached, or refuses the request.
        """
        return await self._ask("/plan", request, PlanResponse)

    async def plan_multistep(self, request: MultistepPlanRequest) -> MultistepPlanResponse:
        """Ask `POST /plan_multistep`; errors as for `plan`."""
        return await self._ask("/plan_multistep", request, MultistepPlanResponse)

    async def wait_until_ready(self, timeout_s: float = 120.0) -> None:
        """Ask `/readyz` until it says yes.

        Raises:
            TimeoutError: it did not within `timeout_s`.
            httpx.HTTPError: the service cannot be reached.
        """
        async with asyncio.timeout(timeout_s):
            while (await self._http.get("/readyz")).status_code != httpx.codes.OK:
                await asyncio.sleep(0.1)

    async def _ask(self, path: str, request: BaseModel, kind: type[Answer]) -> Answer:
        async with self._slots:
            response = await self._http.post(path, json=request.model_dump())
        response.raise_for_status()
        return kind.model_validate_json(response.content)
