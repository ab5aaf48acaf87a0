"""The request of `breakaway plan` or `control`: what a file says, and options that override it."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import click

from app.failure import Failure

if TYPE_CHECKING:
    from app.wire.model import Asked
    from app.wire.problems import FieldError
    from app.wire.requests import MultistepPlanRequest, PlanRequest

T = TypeVar("T", bound="Asked")

AT_REST = (0.0, 0.0)
NAME_OR_JSON = {
    "controller",
    "disturbance",
    "method",
    "nominal_system",
    "pending_controls",
    "sensor",
    "system",
    "uncertainty",
}
"""Fields that are an object or array in JSON; for some of them a name may stand, or a file."""


def read_request(
    file: BinaryIO | None, options: Mapping[str, Any]
) -> "PlanRequest | MultistepPlanRequest":
    """Return the request of a file and options, multi-step where it has targets.

    Args:
        file: JSON of a request, or of a part of one; None where the options are all there is.
        options: fields of the request that were given as options, by name.

    Raises:
        Failure: a part of it is not JSON, or a field is not valid.
        click.UsageError: there is neither a file nor a target.
    """
    from app.wire.requests import MultistepPlanRequest, PlanRequest

    if file is None and "target_state" not in options:
        raise click.UsageError("A plan needs a --target-state, or a --request that has a target.")
    body = {"initial_state": AT_REST} | read_body(file)
    if "target_state" in options:
        body.pop("targets", None)
    if "targets" in body:
        return validated(MultistepPlanRequest, body, options)
    return validated(PlanRequest, body, options)


def validated(kind: type[T], body: Mapping[str, Any], options: Mapping[str, Any]) -> T:
    """Return the request of a body and of options, which override it.

    Raises:
        Failure: a part of an option is not JSON, or a field is not valid.
    """
    from pydantic import ValidationError

    from app.wire.field_errors import field_errors

    given = {**body, **options}
    for field in NAME_OR_JSON & options.keys():
        given[field] = _name_or_parsed(field, options[field])
    if isinstance(given.get("uncertainty"), str):
        given["uncertainty"] = _uncertainty_in(given["uncertainty"])
    try:
        return kind.model_validate(given)
    except ValidationError as error:
        raise _failure(field_errors(error.errors(), given), options) from None


def source(pointer: str, options: Mapping[str, Any]) -> str:
    """Return the name of what gave a field its value: an option, or a JSON pointer into the file.

    Args:
        pointer: to the field, or to a part of it; a part of an option's value stays a pointer.
        options: fields that were given as options, by name.
    """
    field, _, rest = pointer.removeprefix("/").partition("/")
    if field not in options:
        return pointer or "--request"
    option = "--" + field.replace("_", "-")
    return f"{option} /{rest}" if rest else option


def read_body(file: BinaryIO | None) -> dict[str, Any]:
    """Return what a file says; nothing, if there is none.

    Raises:
        Failure: it is no JSON object.
    """
    if file is None:
        return {}
    body = _parse(file.read(), {})
    if not isinstance(body, dict):
        raise Failure("--request: must be a JSON object")
    return body


def _name_or_parsed(field: str, text: str) -> Any:
    """Return the field of a request: a name as it is, or an object or array."""
    if not text.startswith(("{", "[")):
        return text
    return _parse(os.fsencode(text), {field: text}, f"/{field}")


def _uncertainty_in(file: str) -> Any:
    """Return the uncertainty in a file: as a request has it, or the ensemble that a log came to.

    Raises:
        Failure: there is no such file, it is no JSON object, or is a plant without an ensemble.
    """
    try:
        text = Path(file).read_bytes()
    except OSError as error:
        reason = f"{file}: {error.strerror}; it must be a JSON object, or a file of one"
        raise Failure(f"--uncertainty: {reason}") from None
    parsed = _parse(text, {"uncertainty": file}, "/uncertainty")
    if not isinstance(parsed, dict):
        raise Failure(f"--uncertainty: {file}: must be a JSON object")
    if "system" not in parsed:
        return parsed
    if "systems" not in parsed:
        raise Failure(
            f"--uncertainty: {file}: it has one plant only; the ensemble is in the answer of "
            "breakaway identify --json FILE"
        )
    return {"systems": parsed["systems"]}


def _parse(text: bytes, options: Mapping[str, Any], within: str = "") -> Any:
    """Parse JSON as the service does: a file, or the value of the option that is `within`."""
    from app.wire.json_text import InvalidParts, UnreadableJson, parse_json

    try:
        return parse_json(text)
    except UnreadableJson as error:
        raise Failure(f"{source(within, options)}: {error}") from None
    except InvalidParts as error:
        raise _failure(error.errors, options, within) from None


def _failure(
    errors: Iterable["FieldError"], options: Mapping[str, Any], within: str = ""
) -> Failure:
    """Name each part at fault by what it came from; the pointers begin `within` the request."""
    return Failure("\n".join(f"{source(within + e.pointer, options)}: {e.detail}" for e in errors))
