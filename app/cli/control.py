"""`breakaway control`: runs of a controller in this process, without a server."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from app.cli.files import STANDARD_OUTPUT, check_writable, write_text
from app.cli.request_options import json_option, picture_option, request_options
from app.failure import Failure
from app.settings_options import read_settings

if TYPE_CHECKING:
    from app.wire.simulation import SimulateRequest, SimulateResponse


@click.command()
@request_options(
    file="JSON as for POST /simulate; - is standard input.",
    target="Position (m) to come to rest at, and velocity 0.",
    system="The true plant: a machine's name, or its parameters.  [default: the paper's plant]",
    uncertainty="Plants around the nominal one that the controller plans for: those in a FILE of "
    "breakaway identify --json, or by what share parameters may be off, such as "
    '{"relative": {"coulomb_friction": 0.1}}.',
)
@click.option(
    "--controller",
    metavar="NAME|JSON",
    help="A controller's name, such as pid, or an object with its name and options.  "
    "[default: receding_horizon]",
)
@click.option(
    "--nominal-system",
    metavar="NAME|JSON",
    help="What the controller believes of it.  [default: the truth]",
)
@click.option("--steps", type=int, help="Time steps of a run.  [default: 128]")
@click.option(
    "--steps-left",
    type=int,
    help="Time steps until the mass has to be there.  [default: as early as it can]",
)
@click.option(
    "--disturbance",
    metavar="JSON",
    help='Forces that it is not told of, such as {"acceleration_noise": 0.05}.',
)
@click.option(
    "--sensor",
    metavar="JSON",
    help='What is measured, and how well, such as {"position_noise": 0.001}.',
)
@click.option("--delay-steps", type=int, help="Time steps to the actuator.  [default: 0]")
@click.option("--num-runs", type=int, help="Runs of different noise.  [default: 1]")
@json_option
@picture_option("Draw the runs")
def control(
    request_file: BinaryIO | None,
    json_file: Path | None,
    picture: Path | None,
    **fields: Any,
) -> None:
    """Control a simulated machine, and print what came of it.

    A real one is controlled over WS /control of the service. The machine need not be what its
    controller believes. What to simulate is said by a file (--request), by options with the names
    of its fields, or by both: an option overrides what the file says.

    \b
    breakaway control --target-state 0.2 0
    breakaway control --target-state 0.2 0 --system '{"static_friction": 0.8}' \\
        --nominal-system paper --controller pid --num-runs 20 --picture runs.png
    """
    from rich.console import Console

    from app.cli.control_table import print_runs
    from app.cli.files import check_picture_format, write_picture
    from app.cli.plan_request import read_body, validated
    from app.wire.simulation import SimulateRequest

    options = {name: value for name, value in fields.items() if value is not None}
    body = _complete(read_body(request_file), options)
    request = validated(SimulateRequest, body, options)
    if json_file and json_file != STANDARD_OUTPUT:
        check_writable("--json", json_file)
    if picture:
        check_picture_format(picture)
        check_writable("--picture", picture)
    answer = _simulate(request, options, with_states=picture is not None)
    print_runs(Console(stderr=json_file == STANDARD_OUTPUT), request, answer)
    if json_file:
        hidden = set() if "states" in request.include else {"states"}
        text = answer.model_dump_json(
            exclude_none=True, exclude={"runs": {"__all__": hidden}}, indent=1
        )
        write_text("--json", json_file, text)
    if picture:
        from app.figures.runs import draw_runs

        write_picture(lambda: draw_runs(request, answer), picture)


def _complete(body: dict[str, Any], options: dict[str, Any]) -> dict[str, Any]:
    """Return what a file says with what the command takes for granted.

    Raises:
        click.UsageError: there is nothing to aim at, and nothing to do.
    """
    if "controls" in body and "controller" not in options:
        return {"initial_state": (0.0, 0.0)} | body
    if "target_state" not in body and "target_state" not in options:
        raise click.UsageError(
            "A run needs a --target-state, or a --request that has a target or controls."
        )
    return {"initial_state": (0.0, 0.0), "controller": "receding_horizon"} | body


def _simulate(
    request: "SimulateRequest", options: dict[str, Any], with_states: bool
) -> "SimulateResponse":
    """Simulate as the service does, with its settings.

    Raises:
        Failure: it refuses the request.
    """
    from app.cli.plan_request import source
    from app.serving.kernels import CONTROL, PLANNING, prepare
    from app.serving.rates import Rates
    from app.serving.refusals import InvalidField
    from app.serving.simulation import SimulationService
    from app.settings import PLAN_SETTINGS

    if with_states:
        include = [*{*request.include, "states"}]
        request = request.model_copy(update={"include": include})
    service = SimulationService(read_settings(PLAN_SETTINGS), Rates())
    prepare((*PLANNING, *CONTROL))
    try:
        # Twice: the time in the answer is to be the runs', and not that of loading kernels.
        shortest = request.model_copy(update={"num_runs": 1, "steps": 1})
        for asked in (shortest, request):
            answer = service.simulate(service.resolve(asked))
        return answer
    except InvalidField as error:
        raise Failure(f"{source(error.pointer, options)}: {error}") from None
