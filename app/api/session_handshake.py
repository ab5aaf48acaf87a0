"""How a web page opens a session: its key goes, and a refusal comes, by means that a browser has.

A browser sends no header with a WebSocket's handshake but the names of protocols, and tells its
page nothing of a handshake that is refused. So a key may be one of the names, and who asks for our
protocol by name is refused by a message, and a close code that is 4000 and the status.
"""

import json
from base64 import urlsafe_b64decode

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.websockets import WebSocket

PROTOCOL = "breakaway.control"
KEY_PREFIX = "breakaway.key."
"""Before the key in base64url without padding: not all that a key may have may be in a name."""
REFUSED_CODE = 4000


def key_of(connection: HTTPConnection) -> str:
    """Return the key that is among the names of protocols; "" where there is none to be read."""
    for name in connection.scope.get("subprotocols", ()):
        if name.startswith(KEY_PREFIX):
            text = name.removeprefix(KEY_PREFIX)
            try:
                return urlsafe_b64decode(text + "=" * (-len(text) % 4)).decode("ascii")
            except ValueError:
                return ""
    return ""


def protocol_of(websocket: WebSocket) -> str | None:
    """Return the protocol to accept a session with: ours if it was asked for, else none."""
    return PROTOCOL if PROTOCOL in websocket.scope.get("subprotocols", ()) else None


async def refuse(websocket: WebSocket, refusal: Response) -> None:
    """Refuse a session.

    Args:
        websocket: not accepted yet.
        refusal: problem+json; who asks for our protocol is told the same as a message.
    """
    protocol = protocol_of(websocket)
    if protocol is None:
        await websocket.send_denial_response(refusal)
        return
    websocket.state.log_fields["refused"] = refusal.status_code
    await websocket.accept(protocol)
    await websocket.send_text(json.dumps(failure(json.loads(bytes(refusal.body)))))
    await websocket.close(REFUSED_CODE + refusal.status_code)


def failure(problem: dict[str, object]) -> dict[str, object]:
    """Return a problem as a message, whose `type` says what kind of message it is."""
    return problem | {"type": "error", "problem": problem["type"]}
