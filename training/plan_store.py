"""Plans on disk, a file a chunk: what takes long is made once, in any number of processes."""

import hashlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
from tqdm import tqdm

from training.config import PlansConfig, TrainingConfig
from training.experts import Plans, draw_plans
from training.files import write_atomically
from training.streams import Stream, generator
from training.tasks import Tasks


class PlanStore:
    """The plans of a configuration, in chunks by number; each is made at its first use and kept.

    Configurations with the same seed, prior and data have the same plans, and share a folder.

    Args:
        config: of the training.
        data: its section `data`.
        parent: holds the folder with the plans.
    """

    def __init__(self, config: TrainingConfig, data: PlansConfig, parent: Path) -> None:
        self._config, self._data = config, data
        own = {"horizon", "machines", "experts"}
        said = config.model_dump_json(include={"seed": True, "prior": True, "data": own})
        digest = hashlib.sha256(said.encode()).hexdigest()
        self._folder = parent / f"plans-{digest[:12]}"

    def chunk(self, stream: Stream, index: int, size: int) -> Plans:
        """Return so many plans, made now unless they are on disk."""
        path = self._path(stream, index, size)
        try:
            with np.load(path) as kept:
                tasks = Tasks(kept["states"], kept["plants"], kept["spreads"])
                return Plans(kept["controls"].astype(np.float64), tasks)
        except FileNotFoundError:
            controls, tasks = self._make(stream, index, size)
            plans = Plans(controls.astype(np.float32).astype(np.float64), tasks)
            write_atomically(path, partial(_write, plans))
            return plans

    def make(self, stream: Stream, indices: Sequence[int], size: int, processes: int) -> None:
        """Make those of the chunks that are missing, in processes side by side."""
        missing = [index for index in indices if not self._path(stream, index, size).exists()]
        with ProcessPoolExecutor(processes) as pool:
            made = pool.map(_make_one, [(self, stream, index, size) for index in missing])
            for _ in tqdm(made, total=len(missing), unit="chunk", disable=None):
                pass

    def _make(self, stream: Stream, index: int, size: int) -> Plans:
        data = self._data
        rng = generator(self._config.seed, stream, index)
        prior, horizon = self._config.prior, data.horizon
        return draw_plans(data.machines, data.experts, prior, size, horizon, rng)

    def _path(self, stream: Stream, index: int, size: int) -> Path:
        return self._folder / f"{stream.name.lower()}-{index:04}-{size}.npz"


def _make_one(chunk: tuple[PlanStore, Stream, int, int]) -> None:
    store, stream, index, size = chunk
    store.chunk(stream, index, size)


def _write(plans: Plans, file: IO[bytes]) -> None:
    """Write plans; the controls as the network takes them, in single precision."""
    np.savez(
        file,
        controls=plans.controls.astype(np.float32),
        states=plans.tasks.states,
        plants=plans.tasks.plants,
        spreads=plans.tasks.spreads,
    )
