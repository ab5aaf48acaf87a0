"""What is known of a model without running it: its manifest, and how fast its network is."""

from dataclasses import dataclass
from typing import NamedTuple

from app.inference.manifest import Manifest
from app.planning.plant.system import System


class Pace(NamedTuple):
    """What a network does best."""

    rows_at_once: int
    """The fewest rows with which a row takes about the least time."""
    seconds_per_row: float


GUESS = Pace(rows_at_once=32, seconds_per_row=2e-4)
"""About the paper's network by TorchScript on two cores: rather too slow for most. The rates by
which requests are admitted are measured as the model runs."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelCard:
    """A verified model, whether or not it is loaded here."""

    manifest: Manifest
    pace: Pace

    @property
    def label(self) -> str:
        """`name/version`, as requests name it."""
        return self.manifest.label

    @property
    def coverage(self) -> str:
        """The plants and the horizon that the model was trained for, in words."""
        return f"plants with {self.manifest.coverage}, and horizon {self.manifest.horizon}"

    def covers(self, system: System, horizon: int) -> bool:
        """Say whether the model was trained for such a plant and horizon."""
        return self.manifest.covers(system, horizon)
