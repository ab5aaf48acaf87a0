"""`python -m tests.load`: load and trouble for a service, and a verdict."""

import asyncio
import sys
import tempfile
from pathlib import Path

import click
import httpx
from rich.console import Console

from tests.load.chaos import chaos
from tests.load.cluster import cluster
from tests.load.cluster_day import cluster_day
from tests.load.large_answers import large_answers
from tests.load.overload import overload
from tests.load.verdict import Verdict


@click.group()
def load() -> None:
    """Load and trouble for a service, and a verdict."""


@load.command("overload")
@click.option(
    "--url", default="http://127.0.0.1:8000", show_default=True, help="A running service."
)
@click.option("--minutes", default=5.0, show_default=True, help="How long the overload lasts.")
@click.option(
    "--factor", default=4.0, show_default=True, help="Requests asked for, of the capacity."
)
@click.option("--seed", default=0, show_default=True, help="Decides the requests.")
def overload_command(url: str, minutes: float, factor: float, seed: int) -> None:
    """Ask a service for more than it can do."""
    try:
        _tell(asyncio.run(overload(url, 60 * minutes, factor, seed)))
    except httpx.HTTPError as error:
        raise click.BadParameter(f"no service is ready at {url}: {error}") from error


@load.command("chaos")
@click.option("--minutes", default=10.0, show_default=True, help="How long it lasts.")
@click.option("--seed", default=0, show_default=True, help="Decides the requests.")
def chaos_command(minutes: float, seed: int) -> None:
    """Start a service, and treat it badly: clients hang up and send rubbish, models change."""
    with tempfile.TemporaryDirectory() as folder:
        _tell(asyncio.run(chaos(60 * minutes, seed, Path(folder))))


@load.command("large-answers")
@click.option(
    "--clients", default=[16, 60], show_default=True, multiple=True, help="In each crowd."
)
def large_answers_command(clients: list[int]) -> None:
    """Start a service, and ask for 17 MB at once: clients read, then they never do."""
    _tell(asyncio.run(large_answers(clients)))


@load.command("cluster")
@click.option("--minutes", default=3.0, show_default=True, help="How long it lasts.")
@click.option("--kill-every", default=20.0, show_default=True, help="Seconds between two deaths.")
@click.option("--seed", default=0, show_default=True, help="Decides the requests.")
def cluster_command(minutes: float, kill_every: float, seed: int) -> None:
    """Start the service on Ray Serve, and kill one of its replicas again and again."""
    with tempfile.TemporaryDirectory() as folder:
        _tell(asyncio.run(cluster(60 * minutes, kill_every, seed, Path(folder))))


@load.command("cluster-day")
@click.option("--replicas", default=1000, show_default=True)
@click.option("--ingresses", default=8, show_default=True)
@click.option("--seconds", default=30.0, show_default=True, help="Into which the day is pressed.")
@click.option("--deaths", default=3.0, show_default=True, help="Of replicas, a second.")
@click.option("--seed", default=0, show_default=True, help="Decides everything.")
def cluster_day_command(
    replicas: int, ingresses: int, seconds: float, deaths: float, seed: int
) -> None:
    """Simulate a day of a large cluster: its routing and admission, and replicas that die."""
    _tell(cluster_day(replicas, ingresses, seconds, deaths, seed))


def _tell(verdict: Verdict) -> None:
    verdict.print(Console())
    sys.exit(not verdict.passed)


if __name__ == "__main__":
    load()
