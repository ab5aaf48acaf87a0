"""`breakaway identify`: from a log of a machine to its plant, without a server."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.files import STANDARD_OUTPUT, check_writable, write_text
from app.cli.request_options import FILE, picture_option
from app.failure import Failure
from app.settings_options import read_settings

if TYPE_CHECKING:
    from app.wire.identification import IdentifyRequest, IdentifyResponse

COLUMN: dict[str, Any] = {"metavar": "NAME[:UNIT]"}
NUMBER_OR_AUTO = "N|auto"


@click.command()
@click.argument(
    "log_file", metavar="[LOG]", required=False, type=click.Path(path_type=Path, exists=True)
)
@click.option("--time", **COLUMN, help="Column of the times.  [default: time, t or timestamp]")
@click.option("--control", **COLUMN, help="Column of the controls.  [default: control, u, ...]")
@click.option("--position", **COLUMN, help="Column of the positions.  [default: position, p, ...]")
@click.option("--velocity", **COLUMN, help="Column of measured velocities, if there are any.")
@click.option("--time-step", type=float, metavar="S", help="Where no column has times, s.")
@click.option(
    "--known",
    metavar="JSON",
    help='Fields of system that are certain, such as {"control_limit": 10, "bias": 0}.',
)
@click.option(
    "--direction-dependent",
    type=click.Choice(["yes", "no", "auto"]),
    help="Whether frictions may differ by direction; auto lets the log say.  [default: auto]",
)
@click.option(
    "--delay-steps",
    metavar=NUMBER_OR_AUTO,
    help="Time steps that a control takes to the actuator.  [default: auto]",
)
@click.option(
    "--position-lag",
    metavar="S|auto",
    help="Measured positions are those of so long ago: half a time step on most machines, 0 in "
    "simulations that move as the plant does.  [default: auto]",
)
@click.option("--num-systems", type=int, help="Plants of the ensemble.  [default: 32]")
@click.option("--seed", type=int, help="Decides every random draw.")
@click.option(
    "--system",
    "system_file",
    **FILE,
    default=Path("system.json"),
    show_default=True,
    help="Write the plant, as --request of breakaway plan, POST /plan and /simulate take it.",
)
@click.option(
    "--json",
    "json_file",
    **FILE,
    help="Write the answer as the service sends it, with the ensemble, as --uncertainty of "
    "breakaway plan takes it; - is standard output.",
)
@picture_option(
    "Draw what the plant predicts of the log, and its friction",
    default=Path("identification.png"),
    show_default=True,
)
@click.option(
    "--excitation",
    type=click.File("rb"),
    metavar="SYSTEM.json",
    help="Instead of all this write controls to identify a machine by, which is roughly that of "
    "the file, as CSV to standard output, and say how far they move it.",
)
@click.option(
    "--stroke",
    type=click.FloatRange(min=0, min_open=True),
    metavar="M",
    help="With --excitation: travel that there is, m; shorter pushes stay within it.",
)
def identify(
    log_file: Path | None,
    time: str | None,
    control: str | None,
    position: str | None,
    velocity: str | None,
    time_step: float | None,
    system_file: Path,
    json_file: Path | None,
    picture: Path,
    excitation: Any,
    stroke: float | None,
    **fields: Any,
) -> None:
    """Identify a machine from a log, and say how sure that is.

    A LOG has columns by name: .csv, .json or .mat. Units stand in the heading, as in position_mm or
    time [ms], or in an option, as in --position qm:mm; without one it is s, m (or rad) and m/s. A
    control may be in any unit. A .json file may be a whole request for POST /identify, too.

    \b
    breakaway identify log.csv --known '{"control_limit": 10}'
    breakaway identify log.mat --time t --control vir --position qm:m
    breakaway identify --excitation system.json > controls.csv
    """
    from rich.console import Console

    from app.cli.excitation import write_excitation
    from app.cli.files import check_picture_format, write_picture
    from app.cli.identify_table import print_identification, print_written
    from app.cli.log_file import read_log

    if excitation is not None:
        write_excitation(excitation.read(), stroke)
        return
    if stroke is not None:
        raise click.UsageError("--stroke is for --excitation.")
    if log_file is None:
        raise click.UsageError("There must be a LOG, or --excitation with a system.")
    check_picture_format(picture)
    for option, file in (("--system", system_file), ("--picture", picture), ("--json", json_file)):
        if file and file != STANDARD_OUTPUT:
            check_writable(option, file)
    named = {"time": time, "control": control, "position": position, "velocity": velocity}
    log = read_log(log_file, named, time_step)
    request = _request(log_file, log.fields, fields)
    answer = _identify(log_file, request, fields)
    console = Console(stderr=STANDARD_OUTPUT in (json_file, system_file))
    print_identification(console, answer, log.notes)
    system = answer.model_dump(include={"system"}, exclude_none=True)
    write_text("--system", system_file, json.dumps(system, indent=1))
    if json_file:
        write_text("--json", json_file, answer.model_dump_json(exclude_none=True, indent=1))

    def draw() -> Any:
        from app.figures.identification import draw_identification

        return draw_identification(request, answer)

    write_picture(draw, picture)
    print_written(console, answer, system_file, picture, json_file)


def _request(
    log_file: Path, log: Mapping[str, Any], options: Mapping[str, Any]
) -> "IdentifyRequest":
    """Return the request of a log and of options, which override what it says.

    Raises:
        Failure: a field is not valid.
    """
    from pydantic import ValidationError

    from app.wire.field_errors import field_errors
    from app.wire.identification import IdentifyRequest

    given = {name: value for name, value in options.items() if value is not None}
    if "known" in given:
        given["known"] = _parse("--known", given["known"].encode())
    if "direction_dependent" in given:
        by_word: dict[str, Any] = {"yes": True, "no": False}
        given["direction_dependent"] = by_word.get(given["direction_dependent"], "auto")
    for name, number in (("delay_steps", int), ("position_lag", float)):
        if given.get(name, "auto") != "auto":
            try:
                given[name] = number(given[name])
            except ValueError:
                option = name.replace("_", "-")
                raise Failure(f"--{option}: must be a number, or auto") from None
    body = {**log, **given}
    try:
        return IdentifyRequest.model_validate(body)
    except ValidationError as error:
        lines = []
        for fault in field_errors(error.errors(), body):
            field, _, rest = fault.pointer.removeprefix("/").partition("/")
            lines.append(f"{_source(log_file, field, given)}{_within(rest)}: {fault.detail}")
        raise Failure("\n".join(lines)) from None


def _source(log_file: Path, field: str, options: Mapping[str, Any]) -> str:
    """Return the name of what gave a field its value: an option, or the log."""
    is_option = options.get(field) is not None
    return f"--{field.replace('_', '-')}" if is_option else f"{log_file}: /{field}"


def _within(rest: str) -> str:
    """Return where a part of a field is at fault, as it stands behind the field's name."""
    return f" /{rest}" if rest else ""


def _identify(
    log_file: Path, request: "IdentifyRequest", options: Mapping[str, Any]
) -> "IdentifyResponse":
    """Identify as the service does.

    Raises:
        Failure: nothing follows from the log.
    """
    from app.serving.identification import IdentificationService
    from app.serving.kernels import IDENTIFICATION, prepare
    from app.serving.rates import Rates
    from app.serving.refusals import InvalidField
    from app.settings import PLAN_SETTINGS

    prepare(IDENTIFICATION)
    service = IdentificationService(read_settings(PLAN_SETTINGS), Rates())
    try:
        return service.identify(service.resolve(request))
    except InvalidField as error:
        field, _, rest = error.pointer.removeprefix("/").partition("/")
        raise Failure(f"{_source(log_file, field, options)}{_within(rest)}: {error}") from None


def _parse(option: str, text: bytes) -> Any:
    from app.wire.json_text import InvalidParts, UnreadableJson, parse_json

    try:
        return parse_json(text)
    except (UnreadableJson, InvalidParts) as error:
        raise Failure(f"{option}: {error}") from None
