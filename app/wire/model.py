"""What all that travels has in common."""

from pydantic import BaseModel, ConfigDict


class WireModel(BaseModel):
    """A part of a request or an answer; its checks are built when they are first needed."""

    model_config = ConfigDict(defer_build=True)


def build_checks(model: type[WireModel] = WireModel) -> None:
    """Build the checks of all models that are known, for a service, which needs every one.

    FastAPI looks at the models' configuration as well: what is put off would be built outside of
    where it silences Pydantic's warnings.
    """
    for kind in model.__subclasses__():
        kind.model_config["defer_build"] = False
        kind.model_rebuild()
        build_checks(kind)
