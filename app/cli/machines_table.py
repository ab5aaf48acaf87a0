"""What `breakaway models --machines` prints: the machines that have a name."""

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from app.planning.plant.machines import MACHINES
from app.planning.plant.system import ByDirection, ControlLimits

WIDTH = 100
COLUMNS = (
    *("f_s\nm/s²", "f_c\nm/s²", "b\n1/s", "v_s\nm/s", "bias\nm/s²", "gain\nm/s²"),
    *("u_max", "delay\nsteps", "dt\ns"),
)


def print_machines() -> None:
    """Print every machine's parameters, and below them who published them."""
    # Not as narrow as some terminals are: a number that is broken in two is hard to read.
    console = Console(width=WIDTH, highlight=False)
    table = Table(
        Column("machine", no_wrap=True, vertical="bottom"),
        *(Column(heading, justify="right", vertical="bottom", no_wrap=True) for heading in COLUMNS),
        box=SIMPLE,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    for machine in MACHINES.values():
        system = machine.system
        table.add_row(
            machine.name,
            _friction(system.static_friction),
            _friction(system.coulomb_friction),
            _friction(system.viscous_damping),
            "-" if system.stribeck_velocity is None else f"{system.stribeck_velocity:g}",
            f"{system.bias:g}",
            f"{system.control_gain:g}",
            f"{_limit(system.control_limit)} {machine.control_unit}",
            f"{machine.delay_steps}",
            f"{system.time_step:g}",
        )
    console.print(table)
    console.print("\nTwo numbers are friction forward/backward; gain is for each unit of control.")
    for machine in MACHINES.values():
        unit = "" if machine.position_unit == "m" else f" In {machine.position_unit} for m."
        console.print(f"\n{machine.name}: {machine.title}.{unit} {machine.source}")


def _friction(friction: float | ByDirection) -> str:
    if isinstance(friction, ByDirection):
        return f"{friction.forward:.3g}/{friction.backward:.3g}"
    return f"{friction:g}"


def _limit(limit: float | ControlLimits) -> str:
    if isinstance(limit, ControlLimits):
        return f"{limit.lower:g} to {limit.upper:g}"
    return f"{limit:g}"
