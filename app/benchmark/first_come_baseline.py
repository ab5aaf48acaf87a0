"""The service with an engine that serves samplings one after the other, to compare ours with.

`python -m app.benchmark.first_come_baseline` takes the options of `breakaway serve`.
"""

from collections.abc import Sequence
from functools import partial

import click

from app.inference.sampling import Sampling
from app.main import create_app
from app.server import Server
from app.serving.local_runtime import LocalRuntime
from app.settings import Settings
from app.settings_options import SettingsCommand


def first_come_first_served(
    samplings: Sequence[Sampling],
    budget: int,
    tick_seconds: float,  # noqa: ARG001
) -> dict[Sampling, int]:
    """Give every row of a tick to the sampling that came first (a `Share`)."""
    oldest = min(samplings, key=lambda sampling: sampling.job.arrived)
    return {oldest: min(oldest.rows_waiting, budget)}


@click.command(cls=SettingsCommand)
def serve(settings: Settings) -> None:
    """Serve plans over HTTP, whose samplings take turns in the order in which they came."""
    make_runtime = partial(LocalRuntime, share=first_come_first_served)
    Server(create_app(settings, make_runtime), settings).run()


if __name__ == "__main__":
    serve()
