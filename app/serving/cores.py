"""The cores that compiled plans compute on: so many at once, first come, first served."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Cores:
    """Passed from thread to thread: the event loop, which may be late, has no part in it.

    Args:
        number: how many there are.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._taken = 0
        self._waiting: dict[threading.Event, None] = {}
        """In the order in which they came."""
        self._lock = threading.Lock()

    def set_number(self, number: int) -> None:
        """Have so many from now on; whoever is on one too many stays until it is done."""
        with self._lock:
            self._number = number
            self._call()

    @contextmanager
    def one(self, called: threading.Event) -> Iterator[bool]:
        """Wait for a core in this thread, and keep it until the context ends.

        Args:
            called: a new event; set by somebody else, it ends the waiting.

        Yields:
            Whether there is one.
        """
        with self._lock:
            self._waiting[called] = None
            self._call()
        called.wait()
        with self._lock:
            gave_up = called in self._waiting
            if gave_up:
                del self._waiting[called]
        try:
            yield not gave_up
        finally:
            if not gave_up:
                with self._lock:
                    self._taken -= 1
                    self._call()

    def _call(self) -> None:
        """Call those whose turn it is; with the lock."""
        while self._waiting and self._taken < self._number:
            first = next(iter(self._waiting))
            del self._waiting[first]
            self._taken += 1
            first.set()
