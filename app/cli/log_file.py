"""Logs of machines in files: CSV, JSON and MATLAB, as columns by name, in SI units, at even times.

What the columns have to be is checked here as far as it is the file's; the rest by the service.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from app.cli.log_columns import Column, in_si, split
from app.cli.log_csv import read_csv
from app.cli.log_times import at_even_times
from app.failure import Failure

FloatArray = npt.NDArray[np.float64]
ROLES = {
    "time": ("time", "t", "timestamp"),
    "control": ("control", "controls", "u", "command", "input", "force", "voltage", "current"),
    "position": ("position", "positions", "p", "x", "y", "angle", "q"),
    "velocity": ("velocity", "velocities", "v", "speed", "xd", "qd"),
}
"""The names that a column may have, besides those that are given."""


@dataclass(frozen=True, slots=True)
class LogFile:
    """What a file says."""

    fields: dict[str, Any]
    """Of an `IdentifyRequest`."""
    notes: tuple[str, ...]
    """What was assumed, and done to the samples."""


def read_log(file: Path, named: Mapping[str, str | None], time_step: float | None) -> LogFile:
    """Read a log.

    Args:
        file: .csv (or .txt, .tsv), .json or .mat.
        named: for each role a column's name, perhaps with a colon and a unit; None to look for it.
        time_step: s, where no column has times.

    Raises:
        Failure: it cannot be read, or is no log.
    """
    columns = _read(file)
    if (
        {"controls", "positions"} <= columns.keys()
        and "time_step" in columns
        and not any(named.values())
    ):
        return LogFile(columns, ())  # a request as it is
    series = {name: _numbers(values) for name, values in columns.items() if _is_series(values)}
    if not series:
        raise Failure(f"{file}: no column has two values or more; there are {_listed(columns)}")
    found = {role: _find(file, role, name, series) for role, name in named.items()}
    control, position = found["control"], found["position"]
    for role, column in (("control", control), ("position", position)):
        if column is None:
            raise Failure(
                f"{file}: no column is a {role}; there are {_listed(series)}; name one with "
                f"--{role}"
            )
    assert control is not None
    assert position is not None
    chosen = {role: column.values for role, column in found.items() if column and role != "time"}
    notes = [
        f"{column.name} is taken as {role} in {column.unit}"
        for role, column in found.items()
        if column and role != "control" and not column.is_stated
    ]
    if time_step is None and "time_step" in columns:
        time_step = float(np.asarray(columns["time_step"]).item())
    if time_step is None:
        if found["time"] is None:
            raise Failure(
                f"{file}: no column has times; there are {_listed(series)}; name one with --time, "
                "or give --time-step"
            )
        time_step, chosen, note = at_even_times(file, found["time"].values, chosen)
        notes += note
    fields: dict[str, Any] = {
        "time_step": time_step,
        "controls": chosen["control"].tolist(),
        "positions": chosen["position"].tolist(),
    }
    if "velocity" in chosen:
        fields["velocities"] = chosen["velocity"].tolist()
    return LogFile(fields, tuple(notes))


def _read(file: Path) -> dict[str, Any]:
    """Return the columns of a file by name, and what else it has.

    Raises:
        Failure: it cannot be read.
    """
    try:
        match file.suffix.lower():
            case ".json":
                from app.wire.json_text import parse_json

                parsed = parse_json(file.read_bytes())
                if not isinstance(parsed, dict):
                    raise Failure(f"{file}: must be an object with columns by name")
                return parsed
            case ".mat":
                from scipy.io import loadmat
                from scipy.io.matlab import MatReadError

                try:
                    content = loadmat(str(file))
                except MatReadError as error:
                    raise ValueError(str(error)) from None
                return {
                    name: values.squeeze()
                    for name, values in content.items()
                    if not name.startswith("__")
                }
            case _:
                return dict(read_csv(file))
    except OSError as error:
        raise Failure(f"{file}: {error.strerror or error}") from None
    except (ValueError, NotImplementedError, TypeError, csv.Error) as error:
        raise Failure(f"{file}: cannot be read: {error}") from None


def _listed(columns: Iterable[str]) -> str:
    return ", ".join(columns) or "none"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _is_series(values: Any) -> bool:
    return np.ndim(values) == 1 and len(values) > 1 if not isinstance(values, str) else False


def _numbers(values: Sequence[Any]) -> FloatArray:
    """Return a column as numbers; what is none becomes NaN, and is refused where it is needed."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.array([float(v) if _is_number(str(v)) else np.nan for v in values])


def _find(
    file: Path, role: str, name: str | None, series: Mapping[str, FloatArray]
) -> Column | None:
    """Return the column of a role, in SI units.

    Raises:
        Failure: a named one is not there, its unit is not known, or it has something that is no
            number.
    """
    if name is not None:
        name, _, unit = name.partition(":")
        if name not in series:
            raise Failure(f"--{role}: {file} has no column {name!r}; there are {_listed(series)}")
        return in_si(file, role, name, unit or split(name)[1], series[name], is_named=True)
    for heading, values in series.items():
        stem, unit = split(heading)
        if heading.lower() in ROLES[role] or stem.lower() in ROLES[role]:
            return in_si(file, role, heading, unit if stem != heading else "", values)
    return None
