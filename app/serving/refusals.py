"""Why a request is not answered: what the service refuses, and what ends it early."""


class InvalidField(Exception):
    """A field at `pointer` that fits its schema, but not this service or the other fields."""

    def __init__(self, pointer: str, detail: str) -> None:
        super().__init__(detail)
        self.pointer = pointer


class NotReady(Exception):
    """The service is starting, could not start, or is draining."""
