"""What ends a command that cannot do what it was asked: its reason in red, and exit status 1."""

from typing import IO, Any

import click


class Failure(click.ClickException):
    """A reason to end, a line for each thing that is wrong; wrong usage is Click's `UsageError`."""

    def show(self, file: IO[Any] | None = None) -> None:  # noqa: ARG002
        """Print the reason on standard error."""
        from rich.console import Console

        console = Console(stderr=True)
        console.print(self.message, style="red", markup=False, highlight=False, soft_wrap=True)
