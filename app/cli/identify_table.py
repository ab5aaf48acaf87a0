"""What `breakaway identify` prints: the parameters, how well they explain the log, what is open,
and where it all went."""

from collections.abc import Iterable
from pathlib import Path
from textwrap import wrap

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from app.cli.files import STANDARD_OUTPUT
from app.wire.identification import IdentifyResponse

UNITS = {
    "control_gain": "m/s² per unit",
    "viscous_damping": "1/s",
}


def print_identification(
    console: Console, answer: IdentifyResponse, notes: Iterable[str] = ()
) -> None:
    """Print what a log says of a machine, and what it does not say."""
    table = Table(
        Column("parameter", no_wrap=True, vertical="bottom"),
        Column("value", justify="right", vertical="bottom"),
        Column("95 % interval", justify="right", vertical="bottom"),
        Column("unit", no_wrap=True, vertical="bottom"),
        Column("can be\ntold", vertical="bottom"),
        box=SIMPLE,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    for parameter in answer.parameters:
        low, high = parameter.interval
        table.add_row(
            parameter.name,
            f"{parameter.value:.5g}",
            f"{low:.5g} to {high:.5g}",
            UNITS.get(parameter.name.partition(".")[0], "m/s²"),
            "yes" if parameter.identifiable else "no",
        )
    table.add_row("delay", f"{answer.delay_steps}", "", "steps", "")
    table.add_row("lag of positions", f"{answer.position_lag:.3g}", "", "s", "")
    console.print(table, highlight=False)
    fit = answer.fit
    console.print(
        f"\nEnd positions {fit.window_s:.2g} s ahead are off by {1e3 * fit.end_error_rms:.3g} mm "
        f"r.m.s. (r2 {fit.r2:.4f}); the next measurement by {1e3 * fit.residual:.3g} mm; the "
        f"machine moved in {fit.moving_steps} steps; {answer.timing_ms.total:.0f} ms.",
        highlight=False,
    )
    reasons = [f"{p.name}: {p.why_not}" for p in answer.parameters if p.why_not]
    for title, lines in (
        ("Not told by this log", reasons),
        ("Mind", [*notes, *answer.warnings]),
        ("Record next", answer.advice),
    ):
        if lines:
            console.print(f"\n{title}", style="bold")
            for line in lines:
                text = wrap(line, console.width - 2, initial_indent="- ", subsequent_indent="  ")
                console.print("\n".join(text), markup=False, highlight=False)


def print_written(
    console: Console,
    answer: IdentifyResponse,
    system_file: Path,
    picture: Path,
    json_file: Path | None,
) -> None:
    """Print which files were written, and how to plan with them."""
    files = [
        file for file in (system_file, picture, json_file) if file not in {None, STANDARD_OUTPUT}
    ]
    plan = (
        f"breakaway plan --request {system_file} --target-state P V --method dataset_prior --refine"
    )
    if answer.delay_steps:
        plan += f" --pending-controls '{[0] * answer.delay_steps}'"
    ensemble = (
        f"add --uncertainty {json_file}"
        if json_file
        else "write the ensemble here, by --json FILE, and add --uncertainty FILE there"
    )
    console.print(f"\nWritten: {', '.join(map(str, files))}", highlight=False, soft_wrap=True)
    if STANDARD_OUTPUT not in (system_file, json_file):
        for line in (
            f"To plan from rest: {plan}",
            f"To plan for every plant that the log leaves possible: {ensemble}",
        ):
            console.print(line, markup=False, highlight=False, soft_wrap=True)
