"""`breakaway serve`: the service over HTTP."""

import logging
import os
import threading
import webbrowser
from contextlib import suppress
from typing import TYPE_CHECKING

import click

from app.environment import injected_port
from app.failure import Failure
from app.settings_options import SettingsCommand

if TYPE_CHECKING:
    from fastapi import FastAPI

    from app.settings import Settings

log = logging.getLogger(__name__)


@click.command(
    cls=SettingsCommand,
    epilog="Each option can be set in the environment, too: --max-pending is "
    "BREAKAWAY_MAX_PENDING. Lists are separated by commas, or the option is repeated.",
)
@click.option("--open", "opens_page", is_flag=True, help="Show the playground in a browser.")
def serve(settings: "Settings", opens_page: bool) -> None:
    """Serve plans over HTTP."""
    from app.memory import use_few_arenas

    use_few_arenas()
    service = create_service(settings)
    from app.logs import set_up_logging
    from app.server import Server, listen

    try:
        sockets = listen(settings.host, settings.port)
    except OSError as error:
        raise Failure(str(error)) from None
    set_up_logging(settings.log_level, settings.log_format)
    if address := injected_port():
        log.warning(
            "BREAKAWAY_PORT=%s is ignored: it is where an orchestrator has a service, and no port "
            "to listen on (in Kubernetes, enableServiceLinks: false leaves it out)",
            address,
        )
    server = Server(service, settings, _show if opens_page else None)
    with suppress(KeyboardInterrupt):
        server.run(sockets)
    # Not sys.exit: where it ends before it was ready, a thread may be compiling or loading yet.
    logging.shutdown()
    os._exit(1 if server.failed else 0)


def _show(url: str) -> None:
    """Show a page in the user's browser; in a thread, for some browsers keep their caller."""
    threading.Thread(target=webbrowser.open, args=[url], daemon=True).start()


def create_service(settings: "Settings") -> "FastAPI":
    """Return the service, once the files of its models are verified.

    Raises:
        Failure: a model of its store or an API key is not in order.
    """
    from app.api.keys import KeysRejected
    from app.inference.verification import ModelRejected, find_versions, verify
    from app.main import create_app

    try:
        for directory in find_versions(settings.model_store):
            verify(directory)
        return create_app(settings)
    except (ModelRejected, KeysRejected) as error:
        raise Failure(f"cannot serve: {error}") from None
