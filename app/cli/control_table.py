"""What `breakaway control` prints: what the runs are worth, all of them and each."""

from statistics import fmean, median

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from app.wire.simulation import RunReport, SimulateRequest, SimulateResponse

SHOWN_RUNS = 20
HEADINGS = (
    "seed",
    "final error\n(m)",
    "within 1 cm\nfrom (s)",
    "control\nenergy",
    "hunts",
    "status",
)


def print_runs(console: Console, request: SimulateRequest, answer: SimulateResponse) -> None:
    """Print a row for each of the first runs, and what all of them are worth."""
    runs = answer.runs
    title = f"{answer.controller}, seed {answer.seed}\n"
    console.print(title, style="bold", highlight=False)
    table = Table(box=SIMPLE, show_edge=False, padding=(0, 1, 0, 0))
    for heading in HEADINGS:
        table.add_column(heading, justify="right", vertical="bottom")
    time_step = answer.system.time_step
    for run in runs[:SHOWN_RUNS]:
        table.add_row(f"{run.seed}", *_cells(run, time_step))
    console.print(table)
    if len(runs) > SHOWN_RUNS:
        console.print(f"... and {len(runs) - SHOWN_RUNS} more", highlight=False)
    if request.target_state is not None and len(runs) > 1:
        errors = [run.final_error for run in runs if run.final_error is not None]
        settled = [run.settling_step for run in runs if run.settling_step is not None]
        console.print(
            f"\nof {len(runs)} runs: mean final error {fmean(errors):.6f} m, median "
            f"{median(errors):.6f} m, worst {max(errors):.6f} m; {len(settled)} settled within "
            f"1 cm, {sum(run.hunting for run in runs)} hunt",
            highlight=False,
            soft_wrap=True,
        )
    console.print(
        f"{answer.timing_ms.total:.2f} ms, {1e3 * answer.timing_ms.total / _steps(runs):.1f} "
        "microseconds a step",
        highlight=False,
    )


def _cells(run: RunReport, time_step: float) -> tuple[str, ...]:
    return (
        "" if run.final_error is None else f"{run.final_error:.6f}",
        "" if run.settling_step is None else f"{run.settling_step * time_step:.2f}",
        f"{run.control_energy:.3f}",
        "yes" if run.hunting else "no",
        run.status or "",
    )


def _steps(runs: list[RunReport]) -> int:
    return sum(len(run.controls) for run in runs)
