"""Files that a command writes: whether it can, before the work is done, and pictures."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.failure import Failure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STANDARD_OUTPUT = Path("-")


def check_writable(option: str, file: Path) -> None:
    """Find out before the work is done, and not after it, that it has no place to go.

    Raises:
        Failure: it has none.
    """
    is_new = not file.exists()
    try:
        file.open("ab").close()
    except OSError as error:
        raise Failure(f"{option}: {file}: {error.strerror}") from None
    if is_new:
        file.unlink()


def write_text(option: str, file: Path, text: str) -> None:
    """Write a text; - is standard output.

    Raises:
        Failure: the file cannot be written.
    """
    try:
        with click.open_file(str(file), "w", encoding="utf-8") as stream:
            stream.write(text + "\n")
    except OSError as error:
        raise Failure(f"{option}: {file}: {error.strerror}") from None


def check_picture_format(file: Path) -> None:
    """Find out whether a picture can be written into a file of such a name.

    Raises:
        Failure: nobody knows the file's format.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    formats = FigureCanvasBase.get_supported_filetypes()
    if file.suffix.removeprefix(".").lower() not in formats:
        raise Failure(f"--picture: {file} must end in one of: {', '.join(formats)}")


def write_picture(draw: "Callable[[], Figure]", file: Path) -> None:
    """Draw a picture in the style of all and write it.

    Raises:
        Failure: the file cannot be written.
    """
    import matplotlib

    from app.figures.style import STYLE_FILE

    try:
        with matplotlib.rc_context(fname=STYLE_FILE):
            draw().savefig(file)
    except OSError as error:
        raise Failure(f"--picture: {file}: {error.strerror}") from None
