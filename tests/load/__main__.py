"""`python -m tests.load`: load and trouble for a service, and a verdict."""

import asyncio
import tempfile
from pathlib import Path
from typing import Annotated

import httpx
import typer
from rich.console import Console

from tests.load.chaos import chaos
from tests.load.overload import overload
from tests.load.verdict import Verdict

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)

Seed = Annotated[int, typer.Option(help="Decides the requests.")]


@app.command("overload")
def overload_command(
    url: Annotated[str, typer.Option(help="A running service.")] = "http://127.0.0.1:8000",
    minutes: Annotated[float, typer.Option(help="How long the overload lasts.")] = 5.0,
    factor: Annotated[float, typer.Option(help="Requests asked for, of the capacity.")] = 4.0,
    seed: Seed = 0,
) -> None:
    """Ask a service for more than it can do."""
    try:
        _tell(asyncio.run(overload(url, 60 * minutes, factor, seed)))
    except httpx.HTTPError as error:
        raise typer.BadParameter(f"no service is ready at {url}: {error}") from error


@app.command("chaos")
def chaos_command(
    minutes: Annotated[float, typer.Option(help="How long it lasts.")] = 10.0,
    seed: Seed = 0,
) -> None:
    """Start a service, and treat it badly: clients hang up and send rubbish, models change."""
    with tempfile.TemporaryDirectory() as folder:
        _tell(asyncio.run(chaos(60 * minutes, seed, Path(folder))))


def _tell(verdict: Verdict) -> None:
    verdict.print(Console())
    raise typer.Exit(not verdict.passed)


if __name__ == "__main__":
    app()
