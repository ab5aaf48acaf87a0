"""The `breakaway` command."""

import json
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from pydantic import ValidationError
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from app.settings import Settings

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from fastapi import FastAPI

    from app.client.planner_client import AsyncPlannerClient
    from app.planning.plant.plant_range import Bounds
    from app.wire.answers import PlanResponse

ARRIVAL_SECONDS = 30.0
"""How long an evaluation waits for a service that it has not yet seen."""

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


@app.callback()
def breakaway() -> None:
    """Plan open-loop control through dry friction and stiction."""


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
)
def serve(context: typer.Context) -> None:
    """Serve plans over HTTP (`breakaway serve --help` lists the settings)."""
    from app.memory import use_few_arenas

    use_few_arenas()
    settings = _settings(context.args)
    service = _service(settings)
    from app.logs import log_as_json
    from app.server import Server

    log_as_json(settings.log_level)
    with suppress(KeyboardInterrupt):
        Server(service, settings).run()


def _service(settings: Settings) -> "FastAPI":
    """Return the service; if a model of its store or an API key is not in order, exit saying so."""
    from app.api.keys import KeysRejected
    from app.inference.model_store import ModelRejected, find_versions, verify
    from app.main import create_app

    try:
        for directory in find_versions(settings.model_store):
            verify(directory)
        return create_app(settings)
    except (ModelRejected, KeysRejected) as error:
        _fail(f"cannot serve: {error}")


@app.command()
def plan(
    target: Annotated[
        tuple[float, float], typer.Option("--to", help="Target position (m) and velocity (m/s).")
    ],
    start: Annotated[
        tuple[float, float], typer.Option("--from", help="Start position (m) and velocity (m/s).")
    ] = (0.0, 0.0),
    method: Annotated[
        str, typer.Option(help="A method's name, or a JSON object with its name and options.")
    ] = "action_diffusion",
    num_candidates: Annotated[int, typer.Option("--num-candidates", "-k", help="K.")] = 16,
    seed: Annotated[int | None, typer.Option(help="Decides every random draw.")] = None,
    model: Annotated[str | None, typer.Option(help="Model name, or name/version.")] = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Descend from the candidates to a plan that arrives.")
    ] = False,
    objective: Annotated[
        str, typer.Option(help="What ranks plans that arrive equally well.")
    ] = "terminal_error",
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the plan to this file.", dir_okay=False)
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw the plan to this file (.png, .pdf, .svg).", dir_okay=False),
    ] = None,
) -> None:
    """Make one plan in this process, without a server, and print its measures."""
    from app.inference.engine import Engine
    from app.inference.model_store import ModelRejected
    from app.serving.rates import Rates
    from app.serving.refusals import InvalidField
    from app.serving.runtime import available_cores, load_models
    from app.serving.service import PlanningService
    from app.wire.requests import PlanRequest

    try:
        request = PlanRequest.model_validate(
            {
                "initial_state": start,
                "target_state": target,
                "method": _method(method),
                "num_candidates": num_candidates,
                "seed": seed,
                "model": model,
                "refine": refine,
                "objective": objective,
                "include": ["states", "candidates"],
            }
        )
        settings = _settings([])
        engine = Engine(available_cores())
        service = PlanningService(settings, load_models(settings, engine), engine, Rates())
        answer = service.plan(service.resolve(request))
    except json.JSONDecodeError as error:
        _fail(f"--method is neither a name nor a JSON object: {error}")
    except ValidationError as error:
        _fail(_explain(error))
    except (ModelRejected, InvalidField, LookupError, ValueError) as error:
        _fail(str(error))
    _print_plan(answer)
    try:
        if json_file:
            body = answer.model_dump_json(exclude_none=True, exclude={"candidates"}, indent=1)
            json_file.write_text(body + "\n")
        if picture:
            import matplotlib

            from app.figures.plan import draw_plan
            from app.figures.style import STYLE_FILE

            with matplotlib.rc_context(fname=STYLE_FILE):
                draw_plan(request, answer).savefig(picture)
    except (OSError, ValueError) as error:
        _fail(str(error))


@app.command()
def evaluate(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SUITE]...", help="What to evaluate; all suites by default."),
    ] = None,
    url: Annotated[
        str | None, typer.Option(help="A running service. [default: one in this process]")
    ] = None,
    api_key: Annotated[
        str | None,
        typer.Option(envvar="BREAKAWAY_API_KEY", help="For a service that asks for one."),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            help="Keeps answers and report; an interrupted evaluation goes on there.",
            file_okay=False,
        ),
    ] = Path("evaluation"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Sizes cut down to a minute; the numbers mean little.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Decides the tasks and all random draws.")] = 0,
    concurrency: Annotated[
        int,
        typer.Option(min=1, help="Requests under way at once; with more than one, times suffer."),
    ] = 1,
) -> None:
    """Redo the paper's tables and figures, and more, with the answers of a service."""
    import asyncio

    import httpx

    from app.client.planner_client import RequestRefused
    from app.evaluation.answer_log import EvaluationError
    from app.evaluation.run import evaluate
    from app.evaluation.suites import SUITES

    unknown = sorted(set(names or ()) - SUITES.keys())
    if unknown:
        there_are = "\n".join(f"{name:22}{suite.purpose}" for name, suite in SUITES.items())
        _fail(f"no suite {', '.join(unknown)}; there are\n{there_are}")
    suites = [SUITES[name](seed, quick) for name in SUITES if name in (names or SUITES)]
    try:
        report = asyncio.run(
            evaluate(suites, lambda: _client(url, api_key), out, concurrency, Console(stderr=True))
        )
    except (EvaluationError, RequestRefused, OSError) as error:
        _fail(str(error))
    except httpx.HTTPError as error:
        _fail(f"no answer from {url}: {error}")
    except ValidationError as error:
        _fail(f"not an answer of this service: {_explain(error)}")
    except KeyboardInterrupt:
        _fail("interrupted; the same command goes on")
    typer.echo(report)


@asynccontextmanager
async def _client(url: str | None, api_key: str | None) -> "AsyncIterator[AsyncPlannerClient]":
    """Yield a client of the service at `url`, or of one in this process."""
    import httpx
    from asgi_lifespan import LifespanManager

    from app.client.planner_client import AsyncPlannerClient

    async with AsyncExitStack() as stack:
        transport: httpx.AsyncBaseTransport | None = None
        if url is None:
            open_to_us = {"api_keys": None, "api_keys_file": None}
            app = _service(_settings([]).model_copy(update=open_to_us))
            service = await stack.enter_async_context(LifespanManager(app))
            transport = httpx.ASGITransport(service.app)
        else:
            async with AsyncPlannerClient(url, ARRIVAL_SECONDS, api_key=api_key) as arriving:
                await arriving.info()
        client = AsyncPlannerClient(
            url or "http://in-process", transport=transport, api_key=api_key
        )
        yield await stack.enter_async_context(client)


def _method(text: str) -> str | dict[str, Any]:
    """Read a method as requests have it: its name, or a JSON object with its options.

    Raises:
        json.JSONDecodeError: it begins like an object and is none.
    """
    method: str | dict[str, Any] = json.loads(text) if text.startswith("{") else text
    return method


@app.command()
def bench() -> None:
    """Measure the network, sampling, planning and the service, side by side in one run."""
    from app.benchmark.run import run
    from app.inference.model_store import ModelRejected, UnfitModel
    from app.serving.runtime import available_cores

    try:
        for line in run(_settings([]).model_store, available_cores()):
            typer.echo(line)
    except (ModelRejected, UnfitModel) as error:
        _fail(str(error))


@app.command()
def models() -> None:
    """List the models of the store, each checked against its manifest."""
    from app.inference.model_store import ModelRejected, find_versions, verify

    store = _settings([]).model_store
    table = Table(
        Column("model", no_wrap=True), "f_s", "f_c", "b", "u_max", "H", "loss", "sha256", box=SIMPLE
    )
    rejected = []
    try:
        for directory in find_versions(store):
            try:
                manifest, _ = verify(directory)
            except ModelRejected as error:
                rejected.append(str(error))
                continue
            plants = manifest.plants
            table.add_row(
                f"{manifest.name}/{manifest.version}",
                _bounds(plants.static_friction),
                _bounds(plants.coulomb_friction),
                _bounds(plants.viscous_damping),
                _bounds(plants.control_limit),
                str(manifest.horizon),
                f"{manifest.losses.validation:.4f}",
                manifest.sha256[:12],
            )
    except ModelRejected as error:
        _fail(str(error))
    Console().print(table)
    if rejected:
        _fail("\n".join(rejected))


def _bounds(bounds: "Bounds") -> str:
    low, high = bounds
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _settings(arguments: list[str]) -> Settings:
    """Read the settings from flags and environment; on a bad one, say so and exit."""
    try:
        return Settings(_cli_parse_args=arguments)
    except ValidationError as error:
        _fail(_explain(error))


def _explain(error: ValidationError) -> str:
    """Return one line for each value at fault."""
    return "\n".join(
        f"{'.'.join(str(part) for part in item['loc'])}: {item['msg']}" for item in error.errors()
    )


def _fail(message: str) -> NoReturn:
    """Say what is wrong and exit."""
    Console(stderr=True).print(message, style="red", markup=False, soft_wrap=True)
    raise typer.Exit(1)


def _print_plan(answer: "PlanResponse") -> None:
    table = Table(title=f"{answer.method}, seed {answer.seed}", show_header=False)
    rows = {
        "terminal error": f"{answer.terminal_error:.6f}",
        "floor": f"{answer.reachability.floor:.6f}",
        "gap": f"{answer.gap:.2e}",
        "control energy": f"{answer.control_energy:.3f} (m/s²)²",
        "control smoothness": f"{answer.control_smoothness:.3f} (m/s²)²",
        "stuck steps": str(answer.stuck_steps),
        "network evaluations": str(answer.cost.network_evaluations),
        "rollouts": str(answer.cost.rollouts),
        "time": f"{answer.timing_ms.total:.2f} ms",
    }
    if answer.model:
        rows["model"] = f"{answer.model.name}/{answer.model.version}"
    for name, value in rows.items():
        table.add_row(name, value)
    Console().print(table)
