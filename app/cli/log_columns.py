"""Columns of a log: their names, the units in their headings, and their values in SI units."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from app.failure import Failure

FloatArray = npt.NDArray[np.float64]
TURN = 2.0 * np.pi
LENGTHS = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "rad": 1.0,
    "deg": TURN / 360.0,
    "rev": TURN,
}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": TIMES,
    "position": LENGTHS,
    "velocity": {
        **{f"{length}/{time}": a / b for length, a in LENGTHS.items() for time, b in TIMES.items()},
        "rpm": TURN / 60.0,
    },
}
"""What each is in SI; a control may be in any unit."""
HEADING = re.compile(
    r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]$|^(?P<stem>.+)_(?P<suffix>[^_]+)$"
)


class Column(NamedTuple):
    """A column that was found."""

    name: str
    unit: str
    """As it was stated, or the SI unit that is assumed."""
    is_stated: bool
    values: FloatArray
    """(N,), in SI units; a control's in its own."""


def split(heading: str) -> tuple[str, str]:
    """Return the name of a column and the unit in its heading, as in `position [mm]`, `t_ms`."""
    match = HEADING.match(heading)
    if match is None:
        return heading, ""
    return match["name"] or match["stem"], match["unit"] or match["suffix"]


def in_si(
    file: Path,
    role: str,
    name: str,
    unit: str,
    values: FloatArray,
    *,
    is_named: bool = False,
) -> Column:
    """Return a column in SI units.

    Args:
        file: that it is of.
        role: time, control, position or velocity.
        name: its heading, or the name that was given.
        unit: as it is stated; empty for the SI unit.
        values: (N,).
        is_named: whether it was named, and not looked for.

    Raises:
        Failure: its unit is not known, or it has something that is no number.
    """
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise Failure(
            f"{file}: {name} has {wrong.size} values that are no finite numbers, the first in row "
            f"{wrong[0] + 1}"
        )
    units = UNITS.get(role)
    if units is None:
        return Column(name, unit, True, values)
    if not unit or (is_named and unit not in units and ":" not in name):
        return Column(name, next(iter(units)), False, values)
    if unit not in units:
        raise Failure(f"{file}: {name}: the unit {unit!r} is none of {', '.join(units)}")
    return Column(name, unit, True, units[unit] * values)
