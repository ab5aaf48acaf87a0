"""Text with columns, as spreadsheets and loggers write it: CSV with any of the usual dividers."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from app.failure import Failure

FloatArray = npt.NDArray[np.float64]
DIVIDERS = "\t;,|"
"""Of columns, the first that the first line has; spaces, if it has none."""
COMMENT = "#"


def read_csv(file: Path) -> dict[str, FloatArray]:
    """Return the columns of a text by their headings, or by their numbers where there are none.

    A decimal comma is read as a point where the columns are divided by something else. What is no
    number is NaN.

    Raises:
        Failure: it has no rows, or they are of more columns than the first line.
        ValueError, csv.Error, OSError: it cannot be read.
    """
    # With a byte-order mark, which spreadsheets put first, or without.
    lines = [line.partition(COMMENT)[0] for line in file.read_text("utf-8-sig").splitlines()]
    lines = [line for line in lines if line.strip()]
    if not lines:
        raise Failure(f"{file}: cannot be read: there is nothing in it")
    rows = _cells(lines)
    headings = [str(column) for column in range(len(rows[0]))]
    if not all(_is_number(cell) for cell in rows[0]):
        headings = [cell.strip() for cell in rows.pop(0)]
    if not rows:
        raise Failure(f"{file}: there are no rows below the headings {', '.join(headings)}")
    columns: dict[str, FloatArray] = {}
    width = len(headings)
    for number, row in enumerate(rows, 1):
        if any(cell.strip() for cell in row[width:]):
            raise Failure(
                f"{file}: row {number} has {len(row)} values for {width} columns: a decimal comma? "
                "Columns are then to be divided by ; or tabs"
            )
    for column, heading in enumerate(headings):
        cells = [row[column] if column < len(row) else "" for row in rows]
        columns.setdefault(heading, _numbers(cells))
    return columns


def _cells(lines: Sequence[str]) -> list[list[str]]:
    divider = next((divider for divider in DIVIDERS if divider in lines[0]), None)
    if divider is None:
        return [line.split() for line in lines]
    return list(csv.reader(lines, delimiter=divider, skipinitialspace=True))


def _numbers(cells: Sequence[str]) -> FloatArray:
    if not any("." in cell for cell in cells):  # with points as well, commas part the thousands
        cells = [cell.replace(",", ".") for cell in cells]
    return np.array([float(cell) if _is_number(cell) else np.nan for cell in cells])


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
