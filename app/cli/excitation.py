"""What `breakaway identify --excitation` writes: controls to identify a machine by."""

from typing import TYPE_CHECKING

import click

from app.failure import Failure

if TYPE_CHECKING:
    from app.planning.plant.system import System


def write_excitation(text: bytes, stroke: float | None) -> None:
    """Write controls as CSV to standard output, time (s) and control, and say how far they go.

    Args:
        text: JSON of a system, or of a request that has one.
        stroke: m, that the mass is to stay within; None to say only what it takes.

    Raises:
        Failure: there is no system, or nothing that stays within the stroke.
    """
    from app.planning.identification.excitation import StrokeTooShort, excitation, travel

    system = _system_of(text)
    try:
        controls = excitation(system, stroke)
    except StrokeTooShort as error:
        raise Failure(f"--stroke: {error}") from None
    rows = (
        f"{system.time_step * k:.6g},{control:.6g}" for k, control in enumerate(controls.tolist())
    )
    click.echo("\n".join(["time_s,control", *rows]))
    lowest, highest = (round(end, 4) + 0.0 for end in travel(system, controls))
    click.echo(
        f"{len(controls) * system.time_step:.3g} s. By this system the mass goes from "
        f"{lowest:g} to {highest:g} m, from where it starts: leave room on both sides, for "
        "the machine may be another.",
        err=True,
    )


def _system_of(text: bytes) -> "System":
    """Return the system of a file: of a request that has one, or as it is.

    Raises:
        Failure: it has none.
    """
    from pydantic import TypeAdapter, ValidationError

    from app.planning.plant.system import System
    from app.wire.json_text import InvalidParts, UnreadableJson, parse_json

    try:
        parsed = parse_json(text)
    except (UnreadableJson, InvalidParts) as error:
        raise Failure(f"--excitation: {error}") from None
    if isinstance(parsed, dict):
        parsed = parsed.get("system", parsed)
    try:
        return TypeAdapter(System).validate_python(parsed)
    except ValidationError as error:
        first = error.errors()[0]
        where = "/".join(map(str, first["loc"]))
        raise Failure(f"--excitation: {where}: {first['msg']}") from None
