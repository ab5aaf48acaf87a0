"""Just enough HTTP to ask for a plan: httpx takes 1.5 to 3 ms of a core for it, this 0.3 ms."""

import asyncio
from time import monotonic
from typing import NamedTuple
from urllib.parse import urlsplit

KEPT_SECONDS = 2.0
"""How long an idle connection is kept: less than a server does, or requests would meet its end."""
END_OF_HEAD = b"\r\n\r\n"


class NoAnswer(Exception):
    """The connection could not be opened, or ended before the whole answer was there."""


class Response(NamedTuple):
    """An answer, whole."""

    status: int
    headers: dict[str, str]
    """Names in lower case."""
    content: bytes


def request_head(route: str, length: int, headers: dict[str, str]) -> bytes:
    """Return the head of a request with a JSON body of `length` bytes."""
    lines = {
        "Host": "x",
        "Content-Type": "application/json",
        "Content-Length": str(length),
        **headers,
    }
    fields = "".join(f"{name}: {value}\r\n" for name, value in lines.items())
    return f"POST {route} HTTP/1.1\r\n{fields}\r\n".encode()


class Connections:
    """Connections to a service, kept for the next request.

    Args:
        url: http, a host and a port.
    """

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self.address = str(parts.hostname), int(parts.port or 80)
        self._idle: list[tuple[float, asyncio.StreamReader, asyncio.StreamWriter]] = []

    async def post(self, route: str, content: bytes, headers: dict[str, str]) -> Response:
        """Post a body, and read the answer.

        Raises:
            NoAnswer: there is none.
        """
        try:
            reader, writer = await self._connection()
        except OSError as error:
            raise NoAnswer(repr(error)) from error
        try:
            writer.write(request_head(route, len(content), headers) + content)
            head = (await reader.readuntil(END_OF_HEAD)).decode("latin-1")
            first, *fields = head.removesuffix("\r\n\r\n").split("\r\n")
            pairs = (field.split(":", 1) for field in fields)
            found = {name.lower(): value.strip() for name, value in pairs}
            body = await reader.readexactly(int(found["content-length"]))
        except (OSError, EOFError) as error:
            writer.transport.abort()
            raise NoAnswer(repr(error)) from error
        if found.get("connection") == "close":
            writer.close()
        else:
            self._idle.append((monotonic(), reader, writer))
        return Response(int(first.split()[1]), found, body)

    async def _connection(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Return the connection that was used last, or a new one."""
        if self._idle:
            used, reader, writer = self._idle.pop()
            if monotonic() - used < KEPT_SECONDS:
                return reader, writer
            writer.close()
            self.close()  # the others are older
        return await asyncio.open_connection(*self.address)

    def close(self) -> None:
        """Close all that are idle."""
        while self._idle:
            self._idle.pop()[2].close()
