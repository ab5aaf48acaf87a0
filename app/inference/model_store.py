"""The model store: the models of a folder, and which of them a request needs.

PyTorch is loaded with the first model, and not before: a compiled method plans without either.
"""

import logging
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Generic

from typing_extensions import TypeVar

from app.inference.manifest import Manifest
from app.inference.model_card import GUESS, ModelCard
from app.inference.verification import find_skipped, find_versions, verify
from app.planning.plant.system import System

if TYPE_CHECKING:
    import torch

    from app.inference.model import Model
    from app.inference.networks import Kind
    from app.inference.row_threads import RowThreads

M_co = TypeVar("M_co", bound=ModelCard, covariant=True, default="Model")

log = logging.getLogger(__name__)


class UnknownModel(LookupError):
    """No such model, or no such version of it, in the store."""


class UnfitModel(LookupError):
    """No model covers the asked-for plant and horizon."""


class ModelStore(Generic[M_co]):
    """The models of a service, by name and version.

    Args:
        models: in any order.
        skipped: what else is there and is no model, and why.
    """

    def __init__(self, models: Sequence[M_co], skipped: Sequence[str] = ()) -> None:
        self.models = sorted(models, key=_name_and_age)
        self._skipped = skipped
        # Many requests are for few plants, and to look at all ranges of all models takes time.
        self._that_cover = lru_cache(maxsize=1024)(partial(_covering, self.models))

    @staticmethod
    def load(
        directory: Path,
        device: "torch.device",
        threads: "RowThreads",
        kinds: "Sequence[Kind] | None" = None,
        serving: "Sequence[Model] | None" = None,
        wanted: Callable[[Manifest], bool] = lambda _: True,
    ) -> "ModelStore[Model]":
        """Verify every model under `directory`, load and warm up those that do not serve yet.

        Args:
            directory: the store.
            device: where the networks run.
            threads: share out the rows on a CPU.
            kinds: the kinds of networks to choose from; None for all.
            serving: models that are kept if the store still holds the very same; what is new is
                not timed beside them. None at the first start, when nobody is served yet.
            wanted: says which of them are loaded.

        Raises:
            ModelRejected: one of them is not what its manifest says; none is loaded then.
        """
        from app.inference.model import load_model
        from app.inference.networks import KINDS

        verified = [verify(path) for path in find_versions(directory)]
        return ModelStore(
            [
                load_model(manifest, content, device, threads, kinds or KINDS, serving)
                for manifest, content in verified
                if wanted(manifest)
            ],
            _skipped(directory),
        )

    @staticmethod
    def cards(directory: Path) -> "ModelStore[ModelCard]":
        """Verify every model under `directory`, and load none: others run them.

        Raises:
            ModelRejected: one of them is not what its manifest says.
        """
        verified = [verify(path) for path in find_versions(directory)]
        return ModelStore(
            [ModelCard(manifest, GUESS) for manifest, _ in verified], _skipped(directory)
        )

    def find(self, reference: str) -> M_co:
        """Return the model called `name` (its latest version) or `name/version`.

        Raises:
            UnknownModel: there is none.
        """
        for model in self.models:
            if model.manifest.is_called(reference):
                return model
        raise UnknownModel(f"no model {reference!r}; there are: {self._labels()}")

    def covering(self, system: System, horizon: int, *, may_be_off: bool = False) -> M_co:
        """Return the first model by name, in its latest version, that covers plant and horizon.

        For a plant that `may_be_off` the first that knows of such, if there is one.

        Raises:
            UnfitModel: there is none.
        """
        covering = self._that_cover(system, horizon)
        knowing = [model for model in covering if may_be_off and model.manifest.knows_uncertainty]
        if covering:
            return (*knowing, *covering)[0]
        there_are = "; ".join(f"{model.label} for {model.coverage}" for model in self.models)
        raise UnfitModel(
            f"no model was trained for this plant and horizon {horizon} (other methods need none); "
            f"there are: {there_are or 'none'}"
        )

    def _labels(self) -> str:
        labels = ", ".join(model.label for model in self.models) or "none"
        return f"{labels}; skipped: {', '.join(self._skipped)}" if self._skipped else labels


def _covering(models: Sequence[M_co], system: System, horizon: int) -> list[M_co]:
    # No method of a store: its cache would keep the store, and with it models that were replaced.
    return [model for model in models if model.covers(system, horizon)]


def _name_and_age(model: ModelCard) -> tuple[str, int]:
    return model.manifest.name, -model.manifest.version


def _skipped(directory: Path) -> list[str]:
    skipped = find_skipped(directory)
    if skipped:
        log.warning("skipped in the model store %s: %s", directory, ", ".join(skipped))
    return skipped
