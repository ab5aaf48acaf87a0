"""What the network sees in a step, and where it comes from."""

from dataclasses import dataclass
from typing import Protocol

import torch

from app.inference.conditioning import Conditioning
from app.planning.arrays import IntArray
from app.planning.plant.coverage import Coverage
from app.planning.plant.spread import Spread
from training.tasks import Tasks


@dataclass(frozen=True, slots=True)
class Batch:
    """N rows; tensors are float32, on the training device."""

    controls: torch.Tensor
    """(N, 1, H), scaled to [-1, 1]."""
    conditions: torch.Tensor
    """(N, C), standardised."""
    tasks: Tasks | None = None
    """What the plans are for, where the terminal loss asks."""

    def __len__(self) -> int:
        return len(self.controls)

    def rows(self, rows: IntArray | slice) -> "Batch":
        """Return some of the rows."""
        tasks = self.tasks.rows(rows) if self.tasks else None
        index = rows if isinstance(rows, slice) else torch.from_numpy(rows).to(self.controls.device)
        return Batch(self.controls[index], self.conditions[index], tasks)


class Data(Protocol):
    """A source of batches, which the seed and the step alone decide."""

    conditioning: Conditioning
    coverage: Coverage
    uncertainty: Spread
    """By how much the plants of the tasks may be off at most."""
    description: str
    """What the model is trained on, in words."""
    validation: Batch
    """Held out; the same for the whole training."""

    def batch(self, step: int) -> Batch:
        """Return the batch of a step."""
        ...

    def close(self) -> None:
        """Stop making what is not wanted any more."""
        ...
