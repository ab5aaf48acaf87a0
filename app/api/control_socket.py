"""Control sessions over a WebSocket: reads messages, hands them on, and answers each.

What a message does is in app/serving/control_session.py.
"""

import asyncio
import logging
from time import perf_counter

from pydantic import ValidationError
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from app.api.errors import field_problem, problem_of, refusal_of, rejected_of
from app.api.metrics import Metrics
from app.api.session_handshake import failure, protocol_of, refuse
from app.serving.control_session import EndReason, Fields, Session
from app.serving.json_parts import json_parts
from app.serving.refusals import InvalidField, NotReady, OutOfOrder, Refused
from app.serving.runtime import Runtime
from app.wire.field_errors import field_errors
from app.wire.json_text import InvalidParts, UnreadableJson, parse_json
from app.wire.problems import ProblemDetails
from app.wire.sessions import ASKED

PATH = "/control"
CODES: dict[EndReason, int] = {"stopped": 1000, "draining": 1012, "idle": 4408}
"""With which the connection is closed; 1012 is "service restart": go on elsewhere, or later."""
UNEXPECTED_CODE = 1011

log = logging.getLogger(__name__)


async def control_session(websocket: WebSocket) -> None:
    """Control a machine for as long as its client measures."""
    runtime: Runtime = websocket.state.runtime
    waiting = _Waiting(websocket, runtime.settings.session_idle_timeout_s)
    try:
        sessions = runtime.sessions
        with sessions.opened(waiting.wake) as session:
            await websocket.accept(protocol_of(websocket))
            await _converse(websocket, session, waiting)
    except (NotReady, Refused) as error:
        websocket.state.log_fields["rejected"] = rejected_of(error)
        await refuse(websocket, refusal_of(error, websocket))


route = WebSocketRoute(PATH, control_session, name="control_session")


class _Waiting:
    """Waits for the client's next message, until it is idle for too long or woken.

    Args:
        websocket: accepted.
        idle_seconds: how long a client may be silent.
    """

    def __init__(self, websocket: WebSocket, idle_seconds: float) -> None:
        self._websocket = websocket
        self._idle_seconds = idle_seconds
        self._timeout: asyncio.Timeout | None = None
        self._is_woken = False

    def wake(self) -> None:
        """End the wait, now or when it begins: the service is draining."""
        self._is_woken = True
        if self._timeout:
            self._timeout.reschedule(0.0)

    async def receive(self) -> bytes | EndReason:
        """Return the next message's text, or why there is none.

        Raises:
            WebSocketDisconnect: the client has gone.
        """
        if self._is_woken:
            return "draining"
        try:
            async with asyncio.timeout(self._idle_seconds) as self._timeout:
                message = await self._websocket.receive()
        except TimeoutError:
            return "draining" if self._is_woken else "idle"
        finally:
            self._timeout = None
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message["code"])
        text: str | None = message.get("text")
        return text.encode() if text is not None else message["bytes"]


async def _converse(websocket: WebSocket, session: Session, waiting: _Waiting) -> None:
    try:
        while not session.is_over:
            received = await waiting.receive()
            if isinstance(received, str):
                answer = session.end(received)
            else:
                answer = await _answer(websocket, session, received)
            await websocket.send_text(b"".join(json_parts(answer)).decode())
            if answer["type"] == "ended":
                await websocket.close(CODES[answer["reason"]], answer["reason"])
    except WebSocketDisconnect:
        pass  # it ends its own session and nothing else
    except Exception:
        log.exception("a control session failed")
        await websocket.close(UNEXPECTED_CODE)
    finally:
        fields = {"steps": session.steps, "late_steps": session.late_steps}
        websocket.state.log_fields |= fields


async def _answer(websocket: WebSocket, session: Session, text: bytes) -> Fields:
    """Answer one message; what is wrong with it leaves the session as it was."""
    arrived = perf_counter()
    path, metrics = websocket.url.path, websocket.state.metrics
    try:
        body = parse_json(text)
        message = ASKED.validate_python(body)
        answer = await session.answer(message, arrived)
    except ValidationError as error:
        return _failed(field_problem(path, field_errors(error.errors(), body)))
    except (UnreadableJson, InvalidParts, InvalidField, OutOfOrder, Refused) as error:
        return _failed(problem_of(error, path))
    match answer["type"]:
        case "started":
            websocket.state.log_fields["method"] = answer["controller"]
        case "control":
            _count(metrics, session, answer)
    return answer


def _count(metrics: Metrics, session: Session, answer: Fields) -> None:
    assert session.loop is not None
    seconds = answer["timing_ms"]["total"] / 1e3
    metrics.observe_step(session.loop.controller.name, seconds, is_late=answer["late"])


def _failed(problem: ProblemDetails) -> Fields:
    return failure(problem.model_dump(exclude_none=True))
