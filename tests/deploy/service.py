"""The service as an application of Ray Serve, on a small cluster in this machine, for tests.

`python -m tests.deploy.service --port PORT`; with `--kill-every` a replica is killed now and then.
"""

import os
import signal
import tempfile
import threading
from pathlib import Path

import click

os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled"}

import ray
from ray import serve

from app.deploy.ray import ClusterOptions, application
from app.deploy.routing import Order
from app.settings import SHIPPED_MODELS

APPLICATION = "breakaway"
OBJECT_STORE_BYTES = 150 * 2**20
STARTS = 5
KILLED = "killed a replica"
"""What is printed when it was."""


@click.command()
@click.option("--port", type=int, required=True)
@click.option("--model-store", type=Path, default=SHIPPED_MODELS)
@click.option("--replicas", default=1)
@click.option("--kill-every", type=float, help="Seconds between two replicas' deaths.")
def run(port: int, model_store: Path, replicas: int, kill_every: float | None) -> None:
    """Serve until told to end."""
    os.environ |= {"BREAKAWAY_MODEL_STORE": str(model_store), "BREAKAWAY_LOG_LEVEL": "warning"}
    ending = threading.Event()
    for name in (signal.SIGTERM, signal.SIGINT):
        signal.signal(name, lambda *_: ending.set())
    with tempfile.TemporaryDirectory(prefix="ray") as folder:
        begin_cluster(replicas + 1, folder)
        serve.start(http_options={"host": "127.0.0.1", "port": port})
        options = ClusterOptions(min_replicas=replicas, max_replicas=replicas)
        serve.run(application(options), name=APPLICATION)
        while not ending.wait(kill_every):
            kill_one()
        serve.shutdown()  # type: ignore[no-untyped-call]
        ray.shutdown()


def begin_cluster(cores: int, folder: str) -> None:
    """Start Ray; it gives a machine that is busy half a minute, and no more."""
    for tries_left in reversed(range(STARTS)):
        try:
            ray.init(
                address="local",
                num_cpus=cores,
                object_store_memory=OBJECT_STORE_BYTES,
                include_dashboard=False,
                log_to_driver=False,
                _temp_dir=folder,
            )
        except Exception:
            if not tries_left:
                raise
            ray.shutdown()
        else:
            return


def kill_one() -> None:
    """Kill a replica; nobody is told."""
    replicas = serve.get_deployment_handle("replica", APPLICATION)
    process: int = replicas.greet.remote(Order()).result().result
    os.kill(process, signal.SIGKILL)
    print(KILLED, flush=True)


if __name__ == "__main__":
    run()
