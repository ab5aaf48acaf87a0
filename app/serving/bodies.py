"""An answer's body: JSON in parts, compressed where it is large and the client takes it."""

import zlib
from collections import deque
from dataclasses import dataclass
from itertools import chain
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, mmap
from time import sleep
from typing import Any

from app.planning.stop import Stop
from app.serving.json_parts import PART_BYTES, PAUSE_SECONDS, json_parts

GZIP_LEVEL = 1
GZIP_WINDOW = 16 + zlib.MAX_WBITS
"""zlib writes gzip's head and tail, too."""


@dataclass(frozen=True, slots=True)
class Body:
    """An answer's body, as it is sent."""

    parts: deque[bytes | mmap]
    is_gzip: bool

    @property
    def num_bytes(self) -> int:
        """The length of what is still to be sent."""
        return sum(map(len, self.parts))

    def append(self, part: bytes) -> None:
        """Add a part, and keep it in memory of its own.

        The C library would keep what is freed in its heap; this goes back to the system at once.
        """
        if part:
            memory = mmap(-1, len(part), flags=MAP_PRIVATE | MAP_ANONYMOUS)
            memory.write(part)
            self.parts.append(memory)


def make_body(answer: Any, *, accepts_gzip: bool, stop: Stop) -> Body:
    """Write an answer as JSON, and let others have the interpreter between its parts.

    Args:
        answer: for `json_parts`.
        accepts_gzip: whether the client would have it compressed.
        stop: whether it is still wanted.

    Raises:
        Stopped: it is not.
    """
    parts = json_parts(answer)
    first = next(parts)
    if len(first) < PART_BYTES:
        return Body(deque([first]), is_gzip=False)
    compressor = zlib.compressobj(GZIP_LEVEL, wbits=GZIP_WINDOW) if accepts_gzip else None
    body = Body(deque(), compressor is not None)
    for part in chain([first], parts):
        body.append(compressor.compress(part) if compressor else part)
        stop.check()
        sleep(PAUSE_SECONDS)
    if compressor:
        body.append(compressor.flush())
    return body
