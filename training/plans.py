"""Plans for random machines as training data: fresh ones for as long as the network trains."""

import logging
import os
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import torch
from tqdm import tqdm

from app.inference.conditioning import Conditioning
from app.planning.plant.features import SPREAD_FEATURES, feature_values
from app.planning.plant.spread import CERTAIN
from training.batch import Batch
from training.config import PlansConfig, TrainingConfig
from training.experts import Plans
from training.machines import CONDITION
from training.plan_store import PlanStore
from training.streams import Stream, generator
from training.tasks import Tasks

AHEAD = 2
"""Chunks that are made before they are wanted."""

log = logging.getLogger("training")


class PlanData:
    """The latest chunks of plans, and their mirror images.

    The pool is a ring: a new chunk takes the place of the oldest after every `steps_per_chunk`
    steps. The chunks are made in threads beside the training, by kernels that hold no lock.

    Args:
        config: of the training.
        data: its section `data`.
        device: where the tensors are.
        store: keeps the plans.
        begun: the condition of the model that training starts from, if there is one.
    """

    def __init__(
        self,
        config: TrainingConfig,
        data: PlansConfig,
        device: torch.device,
        store: PlanStore,
        begun: Conditioning | None = None,
    ) -> None:
        self._config, self._data, self._device, self._store = config, data, device, store
        held_out = self._plans(Stream.VALIDATION_DATA, 0, data.validation_samples)
        self.conditioning = _conditioning(data, held_out.tasks, begun)
        self.coverage = data.machines.coverage
        self.uncertainty = data.experts.spreads.most if data.experts.robust else CERTAIN
        self.description = f"Plans for random machines and tasks: {data.experts}."
        self.validation = self._prepare(held_out)
        self._threads = ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="plans")
        self._chunks: dict[int, Future[Batch]] = {}
        self._pool: Batch | None = None
        self._last = -1
        """The latest chunk that is in the pool."""

    def batch(self, step: int) -> Batch:
        """Draw a batch from the chunks that belong to the step."""
        data = self._data
        last = data.chunks_in_pool - 1 + step // data.steps_per_chunk
        if last != self._last:
            self._fill(last)
        assert self._pool is not None
        rng = generator(self._config.seed, Stream.SHUFFLE, step)
        size = self._config.optimisation.batch_size
        return self._pool.rows(rng.integers(len(self._pool), size=size))

    def close(self) -> None:
        """Stop making chunks; those under way are finished."""
        self._threads.shutdown(cancel_futures=True)

    def _fill(self, last: int) -> None:
        """Bring the pool to the chunks up to `last`."""
        size = self._data.chunks_in_pool
        missing = range(max(self._last + 1, last + 1 - size), last + 1)
        for index in range(missing.start, last + 1 + AHEAD):
            if index not in self._chunks:
                self._chunks[index] = self._threads.submit(self._chunk, index)
        if len(missing) > 1:
            log.info("making %d plans", len(missing) * self._data.plans_at_once)
        hidden = True if len(missing) == 1 else None
        for index in tqdm(missing, unit="chunk", disable=hidden):
            self._put(self._chunks.pop(index).result(), index % size)
        self._last = last

    def _put(self, chunk: Batch, slot: int) -> None:
        if self._pool is None:
            self._pool = _repeated(chunk, self._data.chunks_in_pool)
        rows = slice(slot * len(chunk), (slot + 1) * len(chunk))
        part = self._pool.rows(rows)
        part.controls[:], part.conditions[:] = chunk.controls, chunk.conditions
        if part.tasks and chunk.tasks:
            part.tasks.states[:], part.tasks.plants[:] = chunk.tasks.states, chunk.tasks.plants
            part.tasks.spreads[:] = chunk.tasks.spreads

    def _chunk(self, index: int) -> Batch:
        return self._prepare(self._plans(Stream.TRAINING_DATA, index, self._data.plans_at_once))

    def _plans(self, stream: Stream, index: int, size: int) -> Plans:
        """Return so many plans, and their mirror images."""
        return self._store.chunk(stream, index, size).with_mirror_images()

    def _prepare(self, plans: Plans) -> Batch:
        tasks, horizon = plans.tasks, self._data.horizon
        conditions = self.conditioning.encode_tasks(tasks.columns, horizon, tasks.spread)
        return Batch(
            torch.tensor(plans.controls[:, None], dtype=torch.float32, device=self._device),
            torch.from_numpy(conditions).to(self._device),
            plans.tasks,
        )


def _conditioning(data: PlansConfig, tasks: Tasks, begun: Conditioning | None) -> Conditioning:
    """Return the condition that tasks make standard.

    What a model was told from which training starts is told as before; what comes to that is 0
    where the plant is known exactly, so that there the plans are those of before.
    """
    features = (*CONDITION, *(SPREAD_FEATURES if data.experts.robust else ()))
    values = feature_values(features, tasks.columns, data.horizon, tasks.spread)
    mean, std = values.mean(axis=0), values.std(axis=0)
    if begun:
        known = len(begun.features)
        if features[:known] != begun.features:
            raise ValueError("the model to start from was told other features of a task")
        mean[:known], std[:known] = begun.mean, begun.std
        mean[known:], std[known:] = 0.0, np.sqrt(np.mean(values[:, known:] ** 2, axis=0))
    return Conditioning(features=features, mean=tuple(mean.tolist()), std=tuple(std.tolist()))


def _repeated(chunk: Batch, times: int) -> Batch:
    """Return room for so many chunks like this one."""
    tasks = chunk.tasks
    return Batch(
        chunk.controls.repeat(times, 1, 1),
        chunk.conditions.repeat(times, 1),
        tasks and tasks.rows(np.tile(np.arange(len(tasks)), times)),
    )
