"""Options that commands share: those that say what is asked for, and where the answer goes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import click

Command: TypeAlias = Callable[..., Any]
Option: TypeAlias = Callable[[Command], Command]

FILE: dict[str, Any] = {"type": click.Path(path_type=Path), "metavar": "FILE"}
STATE: dict[str, Any] = {"type": float, "nargs": 2, "metavar": "P V"}

json_option: Option = click.option(
    "--json",
    "json_file",
    **FILE,
    help="Write the answer as the service sends it; - is standard output.",
)


def request_options(file: str, target: str, system: str, uncertainty: str) -> Option:
    """Return the options of a request from a start to a target; each is given what it is for."""

    def add(command: Command) -> Command:
        for option in (
            click.option("--uncertainty", metavar="FILE|JSON", help=uncertainty),
            click.option("--seed", type=int, help="Decides every random draw."),
            click.option("--system", metavar="NAME|JSON", help=system),
            click.option("--target-state", **STATE, help=target),
            click.option(
                "--initial-state",
                **STATE,
                help="Position (m) and velocity (m/s) at the start.  [default: 0 0]",
            ),
            click.option("--request", "request_file", type=click.File("rb"), help=file),
        ):
            command = option(command)
        return command

    return add


def picture_option(shows: str, **settings: Any) -> Option:
    """Return the option of a picture, and what that shows."""
    return click.option("--picture", **FILE, **settings, help=f"{shows} (.png, .pdf, .svg).")
