"""Clients of the service, waiting and asynchronous, with answers typed by the very schemas it uses.

Both come back by themselves when the service is busy (429), starting or draining (503), or cannot
be reached for a while; what it refuses otherwise is a `RequestRefused`. A request without a seed
gets one here, so that another attempt asks for the same plan.
"""

import asyncio
import secrets
from collections.abc import AsyncIterator, Iterator
from time import sleep
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from app.client.events import AS_EVENTS, Event, events_of
from app.client.retrying import LONGEST_WAIT_SECONDS, read_whole, read_whole_async, retrying
from app.client.unanswered import BROKEN, Unanswered
from app.wire.about import Health, Info, MachineDescription, ModelDescription
from app.wire.answers import MultistepPlanResponse, PlanResponse, Segment
from app.wire.batches import BatchFailure, BatchPlan, PlanBatchRequest
from app.wire.control import ControlRequest, ControlResponse
from app.wire.identification import IdentifyRequest, IdentifyResponse
from app.wire.problems import ProblemDetails
from app.wire.requests import MAX_SEED, MultistepPlanRequest, PlanRequest
from app.wire.simulation import MAX_RUNS, SimulateRequest, SimulateResponse

PATIENCE_SECONDS = 300.0
PAUSE_SECONDS = 0.1
"""Before a batch's rest is asked for."""
TIMEOUT = httpx.Timeout(600.0, connect=LONGEST_WAIT_SECONDS)

Answer = TypeVar("Answer", bound=BaseModel)
MODELS = TypeAdapter(list[ModelDescription], config=ConfigDict(defer_build=True))
MACHINES = TypeAdapter(list[MachineDescription], config=ConfigDict(defer_build=True))


class RequestRefused(Exception):
    """The service refused a request; `problem` says why, with the fields at fault if there are any.

    Args:
        problem: the service's own words.
    """

    def __init__(self, problem: ProblemDetails) -> None:
        super().__init__(f"{problem.title} ({problem.status}): {problem.detail}")
        self.problem = problem


class PlannerClient:
    """Asks a service for plans, one after the other; closes what it opened as a context manager.

    Args:
        url: where the service is.
        patience_s: how long to go on asking a service that is busy, starting or away.
        transport: what carries the requests instead of the network.
        api_key: for a service that asks for one.
    """

    def __init__(
        self,
        url: str,
        patience_s: float = PATIENCE_SECONDS,
        transport: httpx.BaseTransport | None = None,
        api_key: str | None = None,
    ) -> None:
        self._patience_s = patience_s
        again = retrying(transport, patience_s, read_whole)
        self._http = httpx.Client(
            base_url=url, headers=_headers(api_key), transport=again, timeout=TIMEOUT
        )

    def plan(self, request: PlanRequest) -> PlanResponse:
        """Ask `POST /plan`.

        Raises:
            RequestRefused: the service says no.
            httpx.TransportError: it cannot be reached.
        """
        return _read(PlanResponse, self._http.post("/plan", json=_body(request)))

    def plan_multistep(self, request: MultistepPlanRequest) -> MultistepPlanResponse:
        """Ask `POST /plan_multistep`; errors as for `plan`."""
        response = self._http.post("/plan_multistep", json=_body(request))
        return _read(MultistepPlanResponse, response)

    def stream_multistep(
        self, request: MultistepPlanRequest
    ) -> Iterator[Segment | MultistepPlanResponse]:
        """Ask `POST /plan_multistep`; yield each segment as it comes, at last the whole plan.

        Errors as for `plan`; what breaks off after the first segment is not asked for again.
        """
        with self._http.stream(
            "POST", "/plan_multistep", json=_body(request), headers=AS_EVENTS
        ) as response:
            yield from map(_read_event, events_of(_accepted(response).iter_lines()))

    def identify(self, request: IdentifyRequest) -> IdentifyResponse:
        """Ask `POST /identify`; errors as for `plan`."""
        return _read(IdentifyResponse, self._http.post("/identify", json=_body(request)))

    def plan_many(self, request: PlanBatchRequest) -> Iterator[BatchPlan | BatchFailure]:
        """Ask `POST /plan_batch`; yield each line as it comes, `index` says of which problem.

        What a broken connection leaves undone is asked for again. The service works as fast as
        the lines are taken, and no longer than that.

        Raises:
            RequestRefused: the service says no to all of it.
            httpx.TransportError: it cannot be reached, or no longer.
        """
        left = Unanswered(request, self._patience_s)
        while left:
            try:
                with self._http.stream("POST", "/plan_batch", json=left.body()) as response:
                    _accepted(response)
                    for data in response.iter_bytes():
                        yield from left.read(data)
                left.ended()
            except BROKEN as error:
                left.ended(error)
                sleep(PAUSE_SECONDS)

    def simulate(self, request: SimulateRequest) -> SimulateResponse:
        """Ask `POST /simulate`; errors as for `plan`."""
        return _read(SimulateResponse, self._http.post("/simulate", json=_body(request)))

    def control(self, request: ControlRequest) -> ControlResponse:
        """Ask `POST /control` for one step; errors as for `plan`."""
        return _read(ControlResponse, self._http.post("/control", json=_body(request)))

    def models(self) -> list[ModelDescription]:
        """List the models that the service holds; errors as for `plan`."""
        return MODELS.validate_json(_accepted(self._http.get("/models")).content)

    def machines(self) -> list[MachineDescription]:
        """List the machines that requests may name; errors as for `plan`."""
        return MACHINES.validate_json(_accepted(self._http.get("/machines")).content)

    def info(self) -> Info:
        """Ask what answers there; errors as for `plan`."""
        return _read(Info, self._http.get("/info"))

    def wait_until_ready(self) -> None:
        """Return once plans can be made; errors as for `plan`, when patience runs out."""
        _read(Health, self._http.get("/readyz"))

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class AsyncPlannerClient:
    """The same for asynchronous code: any number of requests may be under way at once.

    Args:
        url: where the service is.
        patience_s: how long to go on asking a service that is busy, starting or away.
        transport: what carries the requests instead of the network.
        api_key: for a service that asks for one.
    """

    def __init__(
        self,
        url: str,
        patience_s: float = PATIENCE_SECONDS,
        transport: httpx.AsyncBaseTransport | None = None,
        api_key: str | None = None,
    ) -> None:
        self._patience_s = patience_s
        again = retrying(transport, patience_s, read_whole_async)
        self._http = httpx.AsyncClient(
            base_url=url, headers=_headers(api_key), transport=again, timeout=TIMEOUT
        )

    async def plan(self, request: PlanRequest) -> PlanResponse:
        """Ask `POST /plan`; errors as for `PlannerClient.plan`."""
        response = await self._http.post("/plan", json=_body(request))
        return _read(PlanResponse, response)

    async def plan_multistep(self, request: MultistepPlanRequest) -> MultistepPlanResponse:
        """Ask `POST /plan_multistep`; errors as for `PlannerClient.plan`."""
        response = await self._http.post("/plan_multistep", json=_body(request))
        return _read(MultistepPlanResponse, response)

    async def stream_multistep(
        self, request: MultistepPlanRequest
    ) -> AsyncIterator[Segment | MultistepPlanResponse]:
        """Ask `POST /plan_multistep`, as `PlannerClient.stream_multistep` does."""
        async with self._http.stream(
            "POST", "/plan_multistep", json=_body(request), headers=AS_EVENTS
        ) as response:
            lines = _accepted(response).aiter_lines()
            event: list[str] = []
            async for line in lines:
                event.append(line)
                if not line:
                    yield _read_event(next(events_of(event)))
                    event.clear()

    async def identify(self, request: IdentifyRequest) -> IdentifyResponse:
        """Ask `POST /identify`; errors as for `PlannerClient.plan`."""
        response = await self._http.post("/identify", json=_body(request))
        return _read(IdentifyResponse, response)

    async def plan_many(self, request: PlanBatchRequest) -> AsyncIterator[BatchPlan | BatchFailure]:
        """Ask `POST /plan_batch`; as `PlannerClient.plan_many` does."""
        left = Unanswered(request, self._patience_s)
        while left:
            try:
                async with self._http.stream("POST", "/plan_batch", json=left.body()) as response:
                    _accepted(response)
                    async for data in response.aiter_bytes():
                        for answer in left.read(data):
                            yield answer
                left.ended()
            except BROKEN as error:
                left.ended(error)
                await asyncio.sleep(PAUSE_SECONDS)

    async def simulate(self, request: SimulateRequest) -> SimulateResponse:
        """Ask `POST /simulate`; errors as for `PlannerClient.plan`."""
        response = await self._http.post("/simulate", json=_body(request))
        return _read(SimulateResponse, response)

    async def control(self, request: ControlRequest) -> ControlResponse:
        """Ask `POST /control` for one step; errors as for `PlannerClient.plan`."""
        response = await self._http.post("/control", json=_body(request))
        return _read(ControlResponse, response)

    async def models(self) -> list[ModelDescription]:
        """List the models that the service holds; errors as for `PlannerClient.plan`."""
        return MODELS.validate_json(_accepted(await self._http.get("/models")).content)

    async def machines(self) -> list[MachineDescription]:
        """List the machines that requests may name; errors as for `PlannerClient.plan`."""
        return MACHINES.validate_json(_accepted(await self._http.get("/machines")).content)

    async def info(self) -> Info:
        """Ask what answers there; errors as for `PlannerClient.plan`."""
        return _read(Info, await self._http.get("/info"))

    async def wait_until_ready(self) -> None:
        """Return once plans can be made; errors as for `PlannerClient.wait_until_ready`."""
        _read(Health, await self._http.get("/readyz"))

    async def aclose(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.aclose()


def _body(
    request: PlanRequest
    | MultistepPlanRequest
    | IdentifyRequest
    | SimulateRequest
    | ControlRequest,
) -> dict[str, Any]:
    """Return what is sent, at every attempt the same."""
    body = request.model_dump()
    if request.seed is None:
        body["seed"] = secrets.randbelow(MAX_SEED - MAX_RUNS + 1)
    return body


def _headers(api_key: str | None) -> dict[str, str]:
    return {"Authorization": f"Bearer {api_key}"} if api_key else {}


def _accepted(response: httpx.Response) -> httpx.Response:
    if response.is_success:
        return response
    try:
        problem = ProblemDetails.model_validate_json(response.content)
    except ValidationError:  # not the service: a proxy, or something else at that address
        problem = ProblemDetails(
            type="about:blank",
            title=response.reason_phrase,
            status=response.status_code,
            detail=response.text[:200],
            instance=response.url.path,
        )
    raise RequestRefused(problem)


def _read(kind: type[Answer], response: httpx.Response) -> Answer:
    return kind.model_validate_json(_accepted(response).content)


def _read_event(event: Event) -> Segment | MultistepPlanResponse:
    if event.kind == "problem":
        raise RequestRefused(ProblemDetails.model_validate_json(event.data))
    kind = MultistepPlanResponse if event.kind == "plan" else Segment
    return kind.model_validate_json(event.data)
