"""The `breakaway` command: a file for each thing that it does.

A command imports what it needs when it runs, so that help and small commands are quick.
"""

import click

from app.cli import bench, control, evaluate, identify, models, plan, serve


class OrderedGroup(click.Group):
    """A group whose help lists the commands as they were added, not by the alphabet."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)


@click.group(cls=OrderedGroup)
@click.version_option(package_name="breakaway", message="%(prog)s %(version)s")
def breakaway() -> None:
    """Plan open-loop control through dry friction and stiction."""


COMMANDS = (
    serve.serve,
    plan.plan,
    identify.identify,
    control.control,
    evaluate.evaluate,
    models.models,
    bench.bench,
)
for command in COMMANDS:
    breakaway.add_command(command)
