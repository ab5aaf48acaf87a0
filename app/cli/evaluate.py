"""`breakaway evaluate`: the paper's tables and figures, and ours, from the answers of a service."""

from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.serve import create_service
from app.failure import Failure
from app.settings_options import read_settings

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from app.client.planner_client import AsyncPlannerClient

ARRIVAL_SECONDS = 30.0
"""How long an evaluation waits for a service that it has not yet seen."""


@click.command(context_settings={"show_default": True})
@click.argument("suites", nargs=-1, metavar="[SUITE]...")
@click.option("--url", help="A running service.  [default: one in this process]")
@click.option(
    "--api-key",
    envvar="BREAKAWAY_API_KEY",
    show_envvar=True,
    help="For a service that asks for one.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default="evaluation",
    help="Keeps answers and report; an interrupted evaluation goes on there.",
)
@click.option("--quick", is_flag=True, help="Sizes cut down to a minute; the numbers mean little.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    metavar="INTEGER",
    default=0,
    help="Decides the tasks and all random draws.",
)
@click.option(
    "--concurrency",
    type=click.IntRange(min=1),
    metavar="INTEGER",
    default=1,
    help="Requests under way at once; with more than one, times suffer.",
)
def evaluate(
    suites: tuple[str, ...],
    url: str | None,
    api_key: str | None,
    out: Path,
    quick: bool,
    seed: int,
    concurrency: int,
) -> None:
    """Redo the paper's tables and figures, and more.

    The answers come from a running service, or from one in this process. Without a SUITE all of
    them are evaluated; an unknown one gets a list of those that there are.
    """
    import asyncio

    import httpx
    from pydantic import ValidationError
    from rich.console import Console

    from app.client.planner_client import RequestRefused
    from app.evaluation.answer_log import EvaluationError
    from app.evaluation.run import evaluate as run_evaluation
    from app.evaluation.suites import SUITES
    from app.serving.kernels import ALL, prepare

    if unknown := sorted(set(suites) - SUITES.keys()):
        there_are = "\n".join(f"{name:22}{suite.__doc__}" for name, suite in SUITES.items())
        raise Failure(f"no suite {', '.join(unknown)}; there are\n{there_are}")
    chosen = [SUITES[name](seed, quick) for name in SUITES if name in (suites or SUITES)]
    try:
        if url is None:
            prepare(ALL)
        report = asyncio.run(
            run_evaluation(
                chosen, lambda: connect(url, api_key), out, concurrency, Console(stderr=True)
            )
        )
    except (EvaluationError, RequestRefused, OSError) as error:
        raise Failure(str(error)) from None
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise Failure(f"no answer from {url}: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"]))
        raise Failure(f"not an answer of this service: {field}: {first['msg']}") from None
    except KeyboardInterrupt:
        raise Failure("interrupted; the same command goes on") from None
    click.echo(report)


@asynccontextmanager
async def connect(url: str | None, api_key: str | None) -> "AsyncIterator[AsyncPlannerClient]":
    """Yield a client of the service at `url`, or of one in this process.

    Raises:
        Failure: the service in this process cannot be made.
        RequestRefused: the service at `url` says no, to the key perhaps.
        httpx.HTTPError: it does not answer.
    """
    import httpx
    from asgi_lifespan import LifespanManager

    from app.client.planner_client import AsyncPlannerClient
    from app.settings import PLAN_SETTINGS

    async with AsyncExitStack() as stack:
        transport: httpx.AsyncBaseTransport | None = None
        if url is None:
            app = create_service(read_settings(PLAN_SETTINGS))
            service = await stack.enter_async_context(LifespanManager(app))
            transport = httpx.ASGITransport(service.app)
        else:
            async with AsyncPlannerClient(url, ARRIVAL_SECONDS, api_key=api_key) as arriving:
                await arriving.info()
        client = AsyncPlannerClient(
            url or "http://in-process", transport=transport, api_key=api_key
        )
        yield await stack.enter_async_context(client)
