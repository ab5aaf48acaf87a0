"""Threads that share out the rows of a batch."""

import itertools
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager

from app.inference.courtesy import give_way

ROWS_AT_A_TIME = 8
"""Rows that a thread takes at most before it looks for more: a millisecond of the network."""
ROWS_ALONE = 2
"""Rows for which another thread is not worth its waking up."""


class RowThreads:
    """The calling thread and `num_threads` - 1 helpers."""

    def __init__(self, num_threads: int) -> None:
        self.num_threads = num_threads
        self._lent = 0
        self._lending = threading.Lock()
        self._helpers = ThreadPoolExecutor(
            max_workers=max(num_threads - 1, 1),
            thread_name_prefix="rows",
            initializer=give_way,
        )

    @property
    def lent(self) -> int:
        """Cores that somebody else computes on for long: so many helpers less."""
        return self._lent

    @contextmanager
    def lend(self) -> Iterator[None]:
        """Leave a core to somebody else until the context ends; from any thread."""
        with self._lending:
            self._lent += 1
        try:
            yield
        finally:
            with self._lending:
                self._lent -= 1

    def share(self, rows: int, work: Callable[[slice], None]) -> None:
        """Call `work` on slices that make up `rows` (at least one); return when all are done.

        A thread that is done takes the next slice, so that a core which is busy with something
        else delays a few rows and not its half of them.
        """
        threads = max(1, self.num_threads - self._lent) if rows > ROWS_ALONE else 1
        rounds = -(-rows // (threads * ROWS_AT_A_TIME))
        size = -(-rows // (threads * rounds))
        starts = itertools.count(step=size)

        def take() -> None:
            # next() on a counter is atomic: no two threads get the same rows.
            while (start := next(starts)) < rows:
                work(slice(start, min(start + size, rows)))

        helping = [self._helpers.submit(take) for _ in range(threads - 1)]
        try:
            take()
        finally:
            wait(helping)
        for helper in helping:
            helper.result()

    def close(self) -> None:
        """End the helpers."""
        self._helpers.shutdown()
