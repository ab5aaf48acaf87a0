"""The settings from options of a command and from the environment, checked by `Settings` itself.

There is an option for each field; it overrides the field's variable. Pydantic is imported only by
a command that runs or shows its help.
"""

from collections.abc import Collection, Mapping
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import click

from app.environment import PREFIX, own_variables
from app.failure import Failure

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from app.settings import Settings

CLIENT_VARIABLES = ("api_key",)
"""What a client has in the environment; a server takes it for a mistyped BREAKAWAY_API_KEYS."""
METAVARS = {int: "INTEGER", float: "NUMBER", Path: "PATH"}


class SettingsCommand(click.Command):
    """A command with an option for each setting; its function takes the `Settings`, and its own."""

    @cached_property
    def _options(self) -> list[click.Parameter]:
        from app.settings import Settings

        return [_option(name, field) for name, field in Settings.model_fields.items()]

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        return [*self._options, *super().get_params(ctx)]

    def invoke(self, ctx: click.Context) -> Any:
        from app.settings import Settings

        own = {param.name: ctx.params.pop(param.name) for param in self.params if param.name}
        given = {name: value for name, value in ctx.params.items() if value is not None}
        ctx.params = own | {"settings": _read(Settings.model_fields, given, ())}
        return super().invoke(ctx)


def read_settings(names: Collection[str]) -> "Settings":
    """Read from the environment what a command without a server needs; the rest is the default.

    Raises:
        Failure: a value is not valid, or a variable is no setting's; it names those at fault.
    """
    return _read(names, {}, CLIENT_VARIABLES)


def _read(
    names: Collection[str], options: Mapping[str, Any], no_settings: Collection[str]
) -> "Settings":
    """Read settings from options, or else from the environment.

    Args:
        names: of the settings to read.
        options: those that were given, by name.
        no_settings: variables that the environment may have beside those of settings.
    """
    from pydantic import ValidationError

    from app.settings import Settings

    variables = own_variables()
    known = [*Settings.model_fields, *no_settings]
    lines = [_unknown(name, known) for name in variables if name not in known]
    wanted = {name: variables[name] for name in names if name in variables}
    try:
        settings = Settings.model_validate({**wanted, **options})
    except ValidationError as error:
        for item in error.errors():
            name = str(item["loc"][0])
            lines.append(f"{_flag(name) if name in options else _variable(name)}: {item['msg']}")
    if lines:
        raise Failure("\n".join(lines))
    return settings


def _unknown(name: str, known: Collection[str]) -> str:
    similar = get_close_matches(name, known, n=1)
    hint = f"; did you mean {_variable(similar[0])}?" if similar else ""
    return f"{_variable(name)}: there is no such setting{hint}"


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


def _variable(name: str) -> str:
    return PREFIX + name.upper()


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
