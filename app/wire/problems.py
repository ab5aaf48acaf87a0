"""Problems: why there is no answer, as RFC 9457 has it."""

from collections.abc import Iterable

from pydantic import Field

from app.wire.model import WireModel


class ProblemDetails(WireModel):
    """An error, as RFC 9457 describes it."""

    type: str
    title: str
    status: int
    detail: str
    instance: str = Field(description="The request's path.")
    errors: list["FieldError"] | None = Field(None, description="The fields at fault.")


class FieldError(WireModel):
    """One field at fault."""

    pointer: str = Field(description="JSON pointer into the request body.")
    detail: str


def json_pointer(keys: Iterable[str | int]) -> str:
    """Return the JSON pointer (RFC 6901) of what lies behind `keys`, from the outside in.

    Half of a surrogate pair, which JSON can escape and UTF-8 cannot hold, stays escaped.
    """
    pointer = "".join("/" + str(key).replace("~", "~0").replace("/", "~1") for key in keys)
    return pointer.encode("utf-8", "backslashreplace").decode()
