"""Clients that control a machine: single steps, and sessions over a WebSocket.

A session ends with `SessionEnded`, which holds what another one, here or elsewhere, goes on with.
"""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any, NoReturn

import httpx
from pydantic import BaseModel, ValidationError
from websockets.asyncio.client import ClientConnection as AsyncConnection
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from app.client.planner_client import AsyncPlannerClient, PlannerClient, RequestRefused
from app.wire.control import ControlRequest, ControlResponse
from app.wire.problems import ProblemDetails
from app.wire.sessions import (
    TOLD,
    AskedMessage,
    Control,
    Ended,
    Failed,
    Measure,
    Start,
    Started,
    Stop,
    Target,
    Targeted,
    ToldMessage,
)

PATH = "/control"
LOST = "connection lost"


class SessionEnded(Exception):
    """The session is over, and its client did not stop it.

    Args:
        reason: draining, idle or connection lost.
        resume: begins a session that goes on from the last answer; without a carry it begins anew.
    """

    def __init__(self, reason: str, resume: Start) -> None:
        super().__init__(f"the control session has ended: {reason}")
        self.reason = reason
        self.resume = resume


@dataclass
class _State:
    """What a client knows of its session, for another one to go on."""

    start: Start

    def take(self, told: ToldMessage) -> Started | Control | Targeted | Ended:
        """Keep what an answer says.

        Raises:
            RequestRefused: the service says no; the session goes on.
            SessionEnded: it does not.
        """
        match told:
            case Failed():
                fields = told.model_dump(exclude={"type", "problem"})
                raise RequestRefused(ProblemDetails(type=told.problem, **fields))
            case Ended():
                self._end(told)
            case Control():
                self._go_on(told)
            case Started():  # another session plans for the same plants
                self.start = self.start.model_copy(update={"seed": told.seed})
        return told

    def aim(self, target: Target) -> None:
        """Go to another target from here on."""
        changes = {"target_state": target.target_state, "steps_left": target.steps_left}
        self.start = self.start.model_copy(update=changes)

    def lost(self) -> NoReturn:
        """Raise that nothing is heard any more."""
        raise SessionEnded(LOST, self.start) from None

    def _go_on(self, told: Control) -> None:
        pending, left = self.start.pending_controls, self.start.steps_left
        changes: dict[str, Any] = {
            "pending_controls": [*pending[1:], told.control] if pending else [],
            "steps_left": left and left - 1,
        }
        if told.carry is not None:
            changes["resume"] = told.carry
        self.start = self.start.model_copy(update=changes)

    def _end(self, told: Ended) -> None:
        if told.carry is not None:
            self.start = self.start.model_copy(update={"resume": told.carry})
        if told.reason != "stopped":
            raise SessionEnded(told.reason, self.start)


class ControlSession:
    """A session that has started; `ControlClient.session` opens one."""

    def __init__(self, connection: ClientConnection, state: _State) -> None:
        self._connection = connection
        self._state = state

    def measure(self, position: float, velocity: float | None = None) -> Control:
        """Tell what is measured (m, m/s); return what to send to the machine.

        Raises:
            RequestRefused: the service says no; the session goes on.
            SessionEnded: it is over.
        """
        told = self.ask(Measure(position=position, velocity=velocity))
        assert isinstance(told, Control)
        return told

    def target(self, position: float, steps_left: int | None = None) -> None:
        """Change the target (m), moving or not; errors as for `measure`."""
        target = Target(target_state=(position, 0.0), steps_left=steps_left)
        self.ask(target)
        self._state.aim(target)

    def stop(self) -> Ended:
        """End the session; errors as for `measure`."""
        told = self.ask(Stop())
        assert isinstance(told, Ended)
        return told

    def ask(self, message: AskedMessage) -> Started | Control | Targeted | Ended:
        """Send any message and return its answer; errors as for `measure`."""
        try:
            self._connection.send(_text(message))
            told = self._connection.recv()
        except ConnectionClosed as error:
            told = self._last_word(error)
        return self._state.take(TOLD.validate_json(told))

    def _last_word(self, _: ConnectionClosed) -> str | bytes:
        """Return what the service said before it closed the connection, though nobody asked."""
        try:
            return self._connection.recv(timeout=0)
        except (ConnectionClosed, TimeoutError):
            self._state.lost()


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
            session = ControlSession(connection, _State(start))
            session.ask(start)
            yield session

    def close(self) -> None:
        """Close the connections."""
        self._planner.close()

    def __enter__(self) -> "ControlClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class AsyncControlSession:
    """The same for asynchronous code."""

    def __init__(self, connection: AsyncConnection, state: _State) -> None:
        self._connection = connection
        self._state = state

    async def measure(self, position: float, velocity: float | None = None) -> Control:
        """Tell what is measured; as `ControlSession.measure`."""
        told = await self.ask(Measure(position=position, velocity=velocity))
        assert isinstance(told, Control)
        return told

    async def target(self, position: float, steps_left: int | None = None) -> None:
        """Change the target (m); as `ControlSession.target`."""
        target = Target(target_state=(position, 0.0), steps_left=steps_left)
        await self.ask(target)
        self._state.aim(target)

    async def stop(self) -> Ended:
        """End the session; as `ControlSession.stop`."""
        told = await self.ask(Stop())
        assert isinstance(told, Ended)
        return told

    async def ask(self, message: AskedMessage) -> Started | Control | Targeted | Ended:
        """Send any message and return its answer; as `ControlSession.ask`."""
        try:
            await self._connection.send(_text(message))
            told = await self._connection.recv()
        except ConnectionClosed:
            try:
                told = await self._connection.recv()
            except ConnectionClosed:
                self._state.lost()
        return self._state.take(TOLD.validate_json(told))


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
            session = AsyncControlSession(connection, _State(start))
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


def _text(message: BaseModel) -> str:
    return message.model_dump_json()


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
