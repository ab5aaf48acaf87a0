"""`breakaway bench`: how fast everything is on this machine."""

import click

from app.failure import Failure
from app.settings_options import read_settings


@click.command()
def bench() -> None:
    """Measure network, sampling, planning and service side by side.

    The models are the paper's, dry-friction-fs0.7, and the one that a service chooses, in the
    store that is shipped, or in BREAKAWAY_MODEL_STORE; the output is Markdown.
    """
    from app.benchmark.run import run
    from app.inference.model_store import UnknownModel
    from app.inference.verification import ModelRejected
    from app.serving.kernels import ALL, available_cores, prepare

    prepare(ALL)
    try:
        for line in run(read_settings(["model_store"]).model_store, available_cores()):
            click.echo(line)
    except (ModelRejected, UnknownModel) as error:
        raise Failure(str(error)) from None
