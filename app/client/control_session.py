"""Sessions of a client that controls a machine: what it says, and what it knows to go on elsewhere.

A session ends with `SessionEnded`, which holds what another one, here or elsewhere, goes on with.
"""

from dataclasses import dataclass
from typing import Any, NoReturn

from pydantic import BaseModel
from websockets.asyncio.client import ClientConnection as AsyncConnection
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from app.client.planner_client import RequestRefused
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
class State:
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

    def __init__(self, connection: ClientConnection, state: State) -> None:
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


class AsyncControlSession:
    """The same for asynchronous code."""

    def __init__(self, connection: AsyncConnection, state: State) -> None:
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


def _text(message: BaseModel) -> str:
    return message.model_dump_json()
