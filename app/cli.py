"""The `breakaway` command."""

import json
import sys
from contextlib import AsyncExitStack, asynccontextmanager
from enum import StrEnum
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

    import numpy as np
    from numpy.typing import NDArray

    from app.api.schemas import PlanResponse
    from app.client.multistep_random import Result
    from app.client.planner_client import PlannerClient

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
    settings = _settings(context.args)
    import uvicorn

    from app.inference.model_store import ModelRejected, find_versions, verify
    from app.main import create_app

    try:
        for directory in find_versions(settings.model_store):
            verify(directory)
    except ModelRejected as error:
        _fail(f"cannot serve: {error}")
    uvicorn.run(
        create_app(settings),
        host=settings.host,
        port=settings.port,
        log_level=settings.log_level,
    )


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
    from app.api.errors import InvalidField
    from app.api.runtime import available_cores, start_service
    from app.api.schemas import PlanRequest
    from app.inference.engine import Engine
    from app.inference.model_store import ModelRejected

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
        engine = Engine(available_cores())
        answer = start_service(_settings([]), engine).plan(request)
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
            from app.client.figures import draw_plan

            draw_plan(answer, request.target_state, picture)
    except (OSError, ValueError) as error:
        _fail(str(error))


class Suite(StrEnum):
    """What can be evaluated."""

    MULTISTEP_RANDOM = "multistep-random"
    LEARNED_PRIOR = "learned-prior"
    SAMPLER_FRONTIER = "sampler-frontier"


@app.command()
def evaluate(
    suite: Annotated[
        Suite,
        typer.Argument(
            help="multistep-random: the paper's Table 2. learned-prior: what the learned prior "
            "buys once every method is refined. sampler-frontier: the learned model's error "
            "against network evaluations."
        ),
    ],
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            help="A method's name, or a JSON object with its name and options; may be repeated. "
            "[multistep-random]",
        ),
    ] = None,
    budgets: Annotated[
        list[int] | None,
        typer.Option("--num-candidates", "-k", help="K; may be repeated. [not learned-prior]"),
    ] = None,
    num_sequences: Annotated[
        int, typer.Option("--sequences", min=1, help="Sequences. [not learned-prior]")
    ] = 30,
    num_runs: Annotated[
        int, typer.Option("--runs", min=1, help="Runs of each sequence. [not learned-prior]")
    ] = 5,
    refine: Annotated[
        bool, typer.Option("--refine", help="Refine every plan. [multistep-random]")
    ] = False,
    num_tasks: Annotated[int, typer.Option("--tasks", min=2, help="[learned-prior]")] = 500,
    seed: Annotated[int, typer.Option(min=0, help="Decides the tasks.")] = 0,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw the frontier to this file. [sampler-frontier]", dir_okay=False),
    ] = None,
    url: Annotated[
        str | None, typer.Option(help="A running service. [default: one in this process]")
    ] = None,
) -> None:
    """Evaluate the methods on the same random tasks, the paper's numbers beside."""
    import asyncio

    import httpx

    async def run() -> None:
        async with _client(url) as client:
            if suite is Suite.LEARNED_PRIOR:
                await _evaluate_learned_prior(client, num_tasks, seed)
            elif suite is Suite.SAMPLER_FRONTIER:
                await _evaluate_sampler_frontier(
                    client, budgets or [1, 16, 128], num_sequences, num_runs, seed, picture
                )
            else:
                await _evaluate_multistep_random(
                    client,
                    methods or ["dataset_prior", "cem", "action_diffusion"],
                    budgets or [16, 32, 128],
                    num_sequences,
                    num_runs,
                    seed,
                    refine,
                )

    try:
        asyncio.run(run())
    except json.JSONDecodeError as error:
        _fail(f"--method is neither a name nor a JSON object: {error}")
    except httpx.HTTPStatusError as error:
        _fail(f"the service refused: {error.response.text}")
    except (httpx.HTTPError, TimeoutError) as error:
        _fail(f"no answer from the service: {error}")
    except ValidationError as error:
        _fail(_explain(error))


@asynccontextmanager
async def _client(url: str | None) -> "AsyncIterator[PlannerClient]":
    """Yield a client of the service at `url`, or of one in this process."""
    import httpx
    from asgi_lifespan import LifespanManager

    from app.client.planner_client import PlannerClient
    from app.main import create_app

    async with AsyncExitStack() as stack:
        transport: httpx.AsyncBaseTransport | None = None
        if url is None:
            service = await stack.enter_async_context(LifespanManager(create_app(_settings([]))))
            transport = httpx.ASGITransport(service.app)
        http = httpx.AsyncClient(
            base_url=url or "http://in-process", transport=transport, timeout=None
        )
        client = PlannerClient(await stack.enter_async_context(http))
        await client.wait_until_ready()
        yield client


async def _evaluate_multistep_random(
    client: "PlannerClient",
    methods: list[str],
    budgets: list[int],
    num_sequences: int,
    num_runs: int,
    seed: int,
    refine: bool,
) -> None:
    from app.client.multistep_random import evaluate

    typer.echo(
        f"{num_sequences} sequences x {num_runs} runs, seed {seed}"
        f"{', refined' if refine else ''}: mean ± standard deviation (the paper's mean)\n"
    )
    typer.echo("| method | K | mean end error | floor | final error | stuck steps | ms a plan |")
    typer.echo("| --- | --- | --- | --- | --- | --- | --- |")
    by_label = {_label(method): method for method in map(_method, methods)}
    async for result in evaluate(client, by_label, budgets, num_sequences, num_runs, seed, refine):
        typer.echo(_evaluation_row(result))


def _method(text: str) -> str | dict[str, Any]:
    """Read a method as requests have it: its name, or a JSON object with its options.

    Raises:
        json.JSONDecodeError: it begins like an object and is none.
    """
    method: str | dict[str, Any] = json.loads(text) if text.startswith("{") else text
    return method


def _label(method: str | dict[str, Any]) -> str:
    """Return how a table calls a method."""
    if isinstance(method, str):
        return f"`{method}`"
    options = ", ".join(f"{name} {value}" for name, value in method.items() if name != "name")
    return f"`{method.get('name')}`, {options}"


async def _evaluate_learned_prior(client: "PlannerClient", num_tasks: int, seed: int) -> None:
    from app.client.learned_prior import entrants, evaluate, report

    outcomes = []
    with typer.progressbar(length=len(list(entrants())), file=sys.stderr) as bar:
        async for outcome in evaluate(client, num_tasks, seed):
            outcomes.append(outcome)
            bar.update(1)
    typer.echo(f"{num_tasks} tasks, seed {seed}\n")
    for line in report(outcomes):
        typer.echo(line)


async def _evaluate_sampler_frontier(
    client: "PlannerClient",
    budgets: list[int],
    num_sequences: int,
    num_runs: int,
    seed: int,
    picture: Path | None,
) -> None:
    from app.client.sampler_frontier import MARGIN, SETTINGS, measure, report

    points = []
    with typer.progressbar(length=len(budgets) * len(SETTINGS), file=sys.stderr) as bar:
        async for point in measure(client, budgets, num_sequences, num_runs, seed):
            points.append(point)
            bar.update(1)
    typer.echo(
        f"{num_sequences} sequences x {num_runs} runs, seed {seed}; *: may be more than {MARGIN} m "
        "worse than the paper's setting (95 %, paired)\n"
    )
    for line in report(points):
        typer.echo(line)
    if picture:
        from app.client.figures import draw_frontier

        draw_frontier(points, picture)


def _evaluation_row(result: "Result") -> str:
    from app.client.multistep_random import TARGETS_PER_SEQUENCE

    def spread(values: "NDArray[np.float64]", digits: int) -> str:
        return f"{values.mean():.{digits}f} ± {values.std():.{digits}f}"

    paper = result.paper
    end_error = spread(result.mean_end_errors, 3) + (f" ({paper.mean_end_error})" if paper else "")
    stuck = spread(result.stuck_steps, 1) + (f" ({paper.stuck_steps})" if paper else "")
    return (
        f"| {result.label} | {result.num_candidates} | {end_error} "
        f"| {result.mean_end_floors.mean():.3f} | {spread(result.final_errors, 3)} | {stuck} "
        f"| {result.compute_ms.mean() / TARGETS_PER_SEQUENCE:.2f} |"
    )


@app.command()
def bench() -> None:
    """Measure the network, sampling, planning and the service, side by side in one run."""
    from app.api.runtime import available_cores
    from app.benchmark.run import run
    from app.inference.model_store import ModelRejected, UnfitModel

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
            system = manifest.system
            table.add_row(
                f"{manifest.name}/{manifest.version}",
                f"{system.static_friction:g}",
                f"{system.coulomb_friction:g}",
                f"{system.viscous_damping:g}",
                f"{system.control_limit:g}",
                str(manifest.horizon),
                f"{manifest.losses.validation:.4f}",
                manifest.sha256[:12],
            )
    except ModelRejected as error:
        _fail(str(error))
    Console().print(table)
    if rejected:
        _fail("\n".join(rejected))


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
