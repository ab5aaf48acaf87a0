"""The `breakaway` command."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from app.settings import Settings

if TYPE_CHECKING:
    from app.api.schemas import PlanResponse

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
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the plan to this file.", dir_okay=False)
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw the plan to this file (.png, .pdf, .svg).", dir_okay=False),
    ] = None,
) -> None:
    """Make one plan in this process, without a server, and print its measures."""
    from app.api.errors import BeyondLimit
    from app.api.runtime import available_cores, start_service
    from app.api.schemas import PlanRequest
    from app.inference.engine import Engine
    from app.inference.model_store import ModelRejected

    try:
        request = PlanRequest.model_validate(
            {
                "initial_state": start,
                "target_state": target,
                "method": json.loads(method) if method.startswith("{") else method,
                "num_candidates": num_candidates,
                "seed": seed,
                "model": model,
                "include": ["states", "candidates"],
            }
        )
        engine = Engine(available_cores())
        answer = start_service(_settings([]), engine).plan(request)
    except json.JSONDecodeError as error:
        _fail(f"--method is neither a name nor a JSON object: {error}")
    except ValidationError as error:
        _fail(_explain(error))
    except (ModelRejected, BeyondLimit, LookupError, ValueError) as error:
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


@app.command()
def models() -> None:
    """List the models of the store, each checked against its manifest."""
    from app.inference.model_store import ModelRejected, find_versions, verify

    store = _settings([]).model_store
    table = Table("model", "version", "f_s", "f_c", "b", "u_max", "H", "validation loss", "sha256")
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
                manifest.name,
                str(manifest.version),
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
        return Settings(_cli_parse_args=arguments)  # type: ignore[call-arg]
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
