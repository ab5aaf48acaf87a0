"""Work of a training as tasks on a Ray cluster: what ran in threads or processes runs anywhere.

Every task here is a pure function of its arguments, seeds among them: where it runs, and beside
what, changes nothing in what it returns.
"""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, ParamSpec, TypeVar

import ray

P = ParamSpec("P")
T = TypeVar("T")


class RayExecutor(Executor):
    """Submits calls as tasks to the cluster that RAY_ADDRESS names, or to one on this machine.

    Args:
        cores: of each task.
    """

    def __init__(self, cores: int = 1) -> None:
        self._cores = cores
        self._pending: list[Any] = []
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            ray.init(include_dashboard=False, log_to_driver=False)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> "Future[T]":
        task: Any = ray.remote(num_cpus=self._cores)(_call)
        reference = task.remote(fn, *args, **kwargs)
        self._pending.append(reference)
        future: Future[T] = reference.future()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        if cancel_futures:
            for reference in self._pending:
                ray.cancel(reference)
        elif wait:
            ray.wait(self._pending, num_returns=len(self._pending))
        if self._is_ours:
            ray.shutdown()


def _call(fn: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call it: Ray makes tasks of functions alone, not of partial ones or methods."""
    return fn(*args, **kwargs)
