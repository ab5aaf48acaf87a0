"""The service in this process, with replicas in a cluster: for batch work that speaks no HTTP."""

from collections.abc import Iterator
from contextlib import contextmanager

import ray
from fastapi import FastAPI
from ray import serve

from app.deploy.cluster import ClusterRuntime
from app.deploy.ray import ClusterOptions, replicas_of
from app.main import create_app
from app.settings import Settings

NAME = "breakaway-batch"


@contextmanager
def cluster_service(settings: Settings) -> Iterator[FastAPI]:
    """Yield the service; its replicas end with the context.

    The cluster is the one that RAY_ADDRESS names, or a new one on the cores of this machine; there
    is a replica for each core.

    Args:
        settings: of the service.
    """
    is_ours = not ray.is_initialized()
    if is_ours:
        ray.init(include_dashboard=False, log_to_driver=False)
    cores = int(ray.cluster_resources()["CPU"])  # type: ignore[no-untyped-call]
    options = ClusterOptions(min_replicas=cores, max_replicas=cores)
    try:
        replicas = serve.run(replicas_of(settings, options), name=NAME, route_prefix=None)
        yield create_app(
            settings, lambda settings, _: ClusterRuntime(settings, replicas, options.cores)
        )
    finally:
        serve.delete(NAME)
        if is_ours:
            ray.shutdown()
