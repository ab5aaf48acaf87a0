"""Problems: why there is no answer, as RFC 9457 has it."""

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
