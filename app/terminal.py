"""The terminal of whoever runs a command: one console, so that lines and progress do not mix."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape

TERMINAL = Console(stderr=True)


@contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """Yield what shows a text on the last line of the terminal, and nowhere else."""
    if not TERMINAL.is_terminal:
        yield lambda _: None
        return
    with TERMINAL.status("") as status:
        yield lambda text: status.update(escape(text))
