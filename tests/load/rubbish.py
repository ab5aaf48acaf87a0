"""What no client should send: bad bodies, which have to be told apart, and bad bytes."""

import asyncio
import json
import random
from typing import Any, NamedTuple

GOOD = {"initial_state": [0.0, 0.0], "target_state": [0.2, 0.0], "num_candidates": 2, "seed": 1}
MEGABYTE = 1_000_000
SILENT_SECONDS = 1.0
ONLY_HEAD = b"POST /plan HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"


class Rubbish(NamedTuple):
    """A request in good HTTP that is to be refused."""

    name: str
    status: int
    """What the answer has to be, as problem+json."""
    content: bytes
    http_method: str = "POST"
    route: str = "/plan"
    content_type: str = "application/json"


def _changed(**fields: Any) -> bytes:
    return json.dumps(GOOD | fields).encode()


RUBBISH = [
    Rubbish("no JSON", 400, b'{"initial_state": [0, 0], '),
    Rubbish("nothing", 400, b""),
    Rubbish("another kind of JSON", 422, b"[1, 2, 3]"),
    Rubbish("not UTF-8", 400, b'{"initial_state": "\xff\xfe"}'),
    Rubbish("nested too deep", 400, b"[" * 50_000),
    Rubbish("a number of 10,000 digits", 422, b"[" + b"9" * 10_000 + b"]"),
    Rubbish("another type", 422, _changed(num_candidates="two")),
    Rubbish("NaN", 422, _changed(target_state=[float("nan"), 0.0])),
    Rubbish("infinity", 422, _changed(initial_state=[float("inf"), 0.0])),
    Rubbish("a huge number", 422, _changed(num_candidates=10**300)),
    Rubbish("an unknown field", 422, _changed(candidates=3)),
    Rubbish("half a surrogate for a field", 422, _changed(**{"\ud800": 3})),
    Rubbish("half a surrogate for a model", 422, _changed(model="\ud800")),
    Rubbish("an unknown method", 422, _changed(method="annealing")),
    Rubbish("an unknown model", 404, _changed(model="nope")),
    Rubbish("a plant without a model", 422, _changed(system={"static_friction": 3.0})),
    Rubbish("too much", 422, _changed(num_candidates=4096, method="cem", horizon=1024)),
    Rubbish("no time", 422, _changed(deadline_ms=0)),
    Rubbish("a huge body", 413, b"x" * MEGABYTE),
    Rubbish("another content type", 415, _changed(), content_type="text/plain"),
    Rubbish("no such path", 404, _changed(), route="/plans"),
    Rubbish("a path that climbs", 404, _changed(), route="/../../etc/passwd"),
    Rubbish("the wrong verb", 405, b"", http_method="GET"),
    Rubbish("another wrong verb", 405, _changed(), http_method="DELETE", route="/plan_multistep"),
    Rubbish("no targets", 422, _changed(), route="/plan_multistep"),
]


def bad_bytes(rng: random.Random) -> bytes:
    """Return what is no HTTP, or only the beginning of it."""
    return rng.choice(
        [
            rng.randbytes(rng.randint(1, 2000)),
            ONLY_HEAD[: rng.randint(1, len(ONLY_HEAD))],
            ONLY_HEAD + b"Content-Length: 1000\r\n\r\n" + _changed(),
            ONLY_HEAD + b"Content-Length: -5\r\n\r\n{}",
            ONLY_HEAD + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n",
            b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n",
        ]
    )


async def send_bytes(host: str, port: int, content: bytes, seconds: float) -> bytes:
    """Send `content`, wait, and hang up without a word; return what was said meanwhile.

    Args:
        host: of the service.
        port: of the service.
        content: what to send.
        seconds: how long to wait; an answer does not end it.
    """
    reader, writer = await asyncio.open_connection(host, port)
    writer.write(content)
    await asyncio.sleep(seconds)
    try:
        async with asyncio.timeout(0):
            return await reader.read(MEGABYTE)
    except (TimeoutError, ConnectionError):
        return b""
    finally:
        writer.transport.abort()
