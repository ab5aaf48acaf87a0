"""Clients that control a machine: single steps, and sessions over a WebSocket."""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager

import httpx
from pydantic import ValidationError
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from app.client.control_session import AsyncControlSession, ControlSession, State
from app.client.planner_client import AsyncPlannerClient, PlannerClient, RequestRefused
from app.wire.control import ControlRequest, ControlResponse
from app.wire.problems import ProblemDetails
from app.wire.sessions import Start

PATH = "/control"


class ControlClient:
    """Controls machines by a service; closes what it opened as a context manager.

    Args:
        url: where the service is, as for the other clients.
        api_key: for a service that asks for one.
    """

    def __init__(self, url: str, api_key: str | None = None) -> None:
        self._planner = PlannerClient(url, api_key=api_key)
        self._url = _socket_url(url)
        self._headers = _headers(api_key)

    def step(self, request: ControlRequest) -> ControlResponse:
        """Ask `POST /control` for a single step.

        Raises:
            RequestRefused: the service says no.
            httpx.TransportError: it cannot be reached.
        """
        return self._planner.control(request)

    @contextmanager
    def session(self, start: Start) -> Iterator[ControlSession]:
        """Open a session, which the end of the context ends.

        Raises:
            RequestRefused: the service says no.
            OSError: it cannot be reached.
            SessionEnded: it is over; its `resume` starts another one.
        """
        try:
            connection = connect(self._url, additional_headers=self._headers, compression=None)
        except InvalidStatus as error:
            raise _refused(error) from None
        with connection:
            session = ControlSession(connection, State(start))
            session.ask(start)
            yield session

    def close(self) -> None:
        """Close the connections."""
        self._planner.close()

    def __enter__(self) -> "ControlClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class AsyncControlClient:
    """The same for asynchronous code: any number of sessions at once.

    Args:
        url: where the service is.
        api_key: for a service that asks for one.
    """

    def __init__(self, url: str, api_key: str | None = None) -> None:
        self._planner = AsyncPlannerClient(url, api_key=api_key)
        self._url = _socket_url(url)
        self._headers = _headers(api_key)

    async def step(self, request: ControlRequest) -> ControlResponse:
        """Ask `POST /control` for a single step; errors as for `ControlClient.step`."""
        return await self._planner.control(request)

    @asynccontextmanager
    async def session(self, start: Start) -> AsyncIterator[AsyncControlSession]:
        """Open a session, which the end of the context ends; errors as for `ControlClient`."""
        try:
            connection = await connect_async(
                self._url, additional_headers=self._headers, compression=None
            )
        except InvalidStatus as error:
            raise _refused(error) from None
        async with connection:
            session = AsyncControlSession(connection, State(start))
            await session.ask(start)
            yield session

    async def aclose(self) -> None:
        """Close the connections."""
        await self._planner.aclose()

    async def __aenter__(self) -> "AsyncControlClient":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()


def _socket_url(url: str) -> str:
    address = httpx.URL(url)
    scheme = {"http": "ws", "https": "wss"}.get(address.scheme, address.scheme)
    return str(address.copy_with(scheme=scheme, path=address.path.rstrip("/") + PATH))


def _headers(api_key: str | None) -> dict[str, str]:
    return {"Authorization": f"Bearer {api_key}"} if api_key else {}


def _refused(error: InvalidStatus) -> RequestRefused:
    response = error.response
    try:
        problem = ProblemDetails.model_validate_json(response.body or b"")
    except ValidationError:  # not the service: a proxy, or something else at that address
        problem = ProblemDetails(
            type="about:blank",
            title=response.reason_phrase,
            status=response.status_code,
            detail="no WebSocket was opened",
            instance=PATH,
        )
    return RequestRefused(problem)
