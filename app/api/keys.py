"""API keys: read at start, kept as digests, and asked for at every door that is not public."""

import hmac
import re
from collections.abc import Collection
from hashlib import sha256

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from app.api.errors import problem_response
from app.api.middleware import HttpMiddleware
from app.api.paths import route_path
from app.api.session_handshake import key_of, refuse
from app.settings import Settings

KEY = re.compile(r"[!-~]{16,}")
"""What a header carries unchanged, and nobody guesses."""


class KeysRejected(Exception):
    """The API keys that the settings name cannot be used."""


def read_keys(settings: Settings) -> list[bytes]:
    """Return the SHA-256 digest of each key; none at all where the settings name none.

    Raises:
        KeysRejected: the file cannot be read, a source of keys is empty, or a key is too weak.
    """
    keys: list[str] = []
    if settings.api_keys is not None:
        keys += _keys("api_keys", settings.api_keys.get_secret_value().split(","))
    if settings.api_keys_file is not None:
        try:
            lines = settings.api_keys_file.read_text().splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise KeysRejected(f"cannot read {settings.api_keys_file}: {error}") from None
        written = [line for line in lines if not line.lstrip().startswith("#")]
        keys += _keys(str(settings.api_keys_file), written)
    return [_digest(key) for key in keys]


def is_public(path: str, public_paths: Collection[str]) -> bool:
    """Say whether a path is among the public ones; "/folder/*" stands for all below it."""
    folders = tuple(public[:-1] for public in public_paths if public.endswith("/*"))
    return path in public_paths or path.startswith(folders)


class ApiKeys(HttpMiddleware):
    """Answer 401 where a key is needed and none of `digests` belongs to the one that is sent."""

    def __init__(self, app: ASGIApp, digests: list[bytes], public_paths: Collection[str]) -> None:
        super().__init__(app)
        self.digests = digests
        self.public_paths = public_paths

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        connection = HTTPConnection(scope)
        if self._is_open_to(connection, _bearer_of(connection)):
            await self.app(scope, receive, send)
        else:
            await _refusal(connection)(scope, receive, send)

    async def handle_session(self, scope: Scope, receive: Receive, send: Send) -> None:
        websocket = WebSocket(scope, receive, send)
        if self._is_open_to(websocket, _bearer_of(websocket) or key_of(websocket)):
            await self.app(scope, receive, send)
        else:
            await refuse(websocket, _refusal(websocket))

    def _is_open_to(self, connection: HTTPConnection, key: str) -> bool:
        digest = _digest(key)
        matches = [hmac.compare_digest(digest, known) for known in self.digests]  # no early exit
        return any(matches) or is_public(route_path(connection.scope), self.public_paths)


def _bearer_of(connection: HTTPConnection) -> str:
    """Return the key of `Authorization: Bearer <key>`; "" if there is none."""
    scheme, _, key = connection.headers.get("authorization", "").partition(" ")
    return key.strip() if scheme.lower() == "bearer" else ""


def _refusal(connection: HTTPConnection) -> Response:
    return problem_response(
        connection,
        401,
        "send a valid key as Authorization: Bearer <key>",
        headers={"WWW-Authenticate": "Bearer"},
    )


def _keys(source: str, texts: list[str]) -> list[str]:
    keys = [key for text in texts if (key := text.strip())]
    if not keys:
        raise KeysRejected(f"{source} holds no key")
    for number, key in enumerate(keys, 1):
        if not KEY.fullmatch(key):
            raise KeysRejected(
                f"key {number} of {source} must be at least 16 ASCII characters without blanks"
            )
    return keys


def _digest(key: str) -> bytes:
    return sha256(key.encode()).digest()
