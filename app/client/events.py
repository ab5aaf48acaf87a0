"""Server-sent events as the service writes them: a name and a line of data each."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

EVENT_STREAM = "text/event-stream"
AS_EVENTS = {"Accept": EVENT_STREAM}


class Event(NamedTuple):
    """What came in one event."""

    kind: str
    data: str


def events_of(lines: Iterable[str]) -> Iterator[Event]:
    """Read events from the lines of a stream; a last one that is not whole is left out."""
    fields: dict[str, str] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(": ")
            fields[name] = value
        elif fields:
            yield Event(fields["event"], fields["data"])
            fields = {}
