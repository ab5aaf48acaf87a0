"""What all that travels has in common."""

from pydantic import BaseModel, ConfigDict, Strict

ARRAY = Strict(False)
"""A list or a tuple may stand for an array; what is in it is checked strictly all the same."""


class WireModel(BaseModel):
    """A part of a request or an answer; its checks are built when they are first needed."""

    model_config = ConfigDict(defer_build=True)


class Asked(WireModel):
    """A part of a request: of the very types that its schema names, and nothing beside."""

    model_config = ConfigDict(extra="forbid", strict=True)


def build_checks(model: type[WireModel] = WireModel) -> None:
    """Build the checks of all models that are known, for a service, which needs every one.

    FastAPI looks at the models' configuration as well: what is put off would be built outside of
    where it silences Pydantic's warnings.
    """
    for kind in model.__subclasses__():
        kind.model_config["defer_build"] = False
        kind.model_rebuild()
        build_checks(kind)
