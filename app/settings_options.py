"""The settings as options of a command: one for each field, checked by `Settings` itself.

An option overrides its environment variable. Pydantic is imported only by a command that runs or
shows its help.
"""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import click

from app.failure import Failure

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from app.settings import Settings

METAVARS = {int: "INTEGER", float: "NUMBER", Path: "PATH"}


class SettingsCommand(click.Command):
    """A command with an option for each setting; its function takes the `Settings`."""

    @cached_property
    def _options(self) -> list[click.Parameter]:
        from app.settings import Settings

        return [_option(name, field) for name, field in Settings.model_fields.items()]

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        return [*self._options, *super().get_params(ctx)]

    def invoke(self, ctx: click.Context) -> Any:
        given = {name: value for name, value in ctx.params.items() if value is not None}
        ctx.params = {"settings": read_settings(given)}
        return super().invoke(ctx)


def read_settings(options: dict[str, Any] | None = None) -> "Settings":
    """Read the settings from the environment, and from options that were given.

    Raises:
        Failure: a value is not valid; it names the options and variables at fault.
    """
    from pydantic import ValidationError

    from app.settings import Settings

    options = options or {}
    try:
        return Settings(**options)
    except ValidationError as error:
        lines = []
        for item in error.errors():
            name = str(item["loc"][0])
            source = _flag(name) if name in options else f"BREAKAWAY_{name.upper()}"
            lines.append(f"{source}: {item['msg']}")
        raise Failure("\n".join(lines)) from None


def _option(name: str, field: "FieldInfo") -> click.Option:
    """Return the option of a setting; None says that it is not given."""
    kind, default = field.annotation, field.default
    declaration = _flag(name)
    if kind is bool:
        declaration += f"/{_flag(f'no_{name}')}"
        default = "yes" if default else "no"
    if is_list := get_origin(kind) is tuple:
        default = ",".join(default)
    return click.Option(
        [declaration],
        type=bool if kind is bool else str,
        default=None,
        multiple=is_list,
        callback=_join if is_list else None,
        metavar=_metavar(kind),
        help=(field.description or "")
        + (f"  [default: {default}]" if default not in (None, "") else ""),
    )


def _join(_: click.Context, __: click.Parameter, values: tuple[str, ...]) -> str | None:
    """Return the values of a repeated option as one list, separated by commas."""
    return ",".join(values) if values else None


def _metavar(kind: Any) -> str:
    """Return what stands for a value of an annotation's kind in a command's help."""
    if get_origin(kind) is Literal:
        return "|".join(get_args(kind))
    if get_origin(kind) is tuple:
        return "TEXT,..."
    kinds = (kind, *get_args(kind))
    return next((name for known, name in METAVARS.items() if known in kinds), "TEXT")


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
