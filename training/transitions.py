"""The synthetic transitions that the paper's model learns from (paper, Sect. 4.2)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch

from app.inference.conditioning import Conditioning
from app.planning.arrays import FloatArray, IntArray
from app.planning.plant.coverage import Coverage
from app.planning.plant.rollout import rollout
from app.planning.plant.spread import CERTAIN
from app.planning.plant.system import System
from app.planning.plant.task import Task
from training.batch import Batch
from training.config import TrainingConfig, TransitionsConfig
from training.streams import Stream, generator


@dataclass(frozen=True, slots=True)
class Transitions:
    """N control sequences with the states that they connect."""

    controls: FloatArray
    """(N, H), m/s^2."""
    initial_states: FloatArray
    """(N, 2), m and m/s."""
    terminal_states: FloatArray
    """(N, 2)."""


def sample_transitions(
    config: TrainingConfig, data: TransitionsConfig, num_samples: int, rng: np.random.Generator
) -> Transitions:
    """Draw initial states uniformly and controls from the prior; roll them out."""
    position = rng.uniform(*data.position_range, num_samples)
    velocity = rng.uniform(*data.velocity_range, num_samples)
    initial_states = np.stack([position, velocity], axis=1)
    controls = config.prior.sample(num_samples, data.horizon, config.system.plant, rng)
    terminal_states = rollout(config.system, initial_states, controls)[:, -1]
    return Transitions(controls, initial_states, terminal_states)


def state_conditioning(transitions: Transitions) -> Conditioning:
    """Return the paper's condition, standardised by initial and terminal states together."""
    states = np.concatenate([transitions.initial_states, transitions.terminal_states])
    return Conditioning.on_states(states.mean(axis=0).tolist(), states.std(axis=0).tolist())


class TransitionData:
    """A fixed set of transitions, shuffled anew in every epoch.

    Args:
        config: of the training.
        data: its section `data`.
        device: where the tensors are.
    """

    def __init__(
        self, config: TrainingConfig, data: TransitionsConfig, device: torch.device
    ) -> None:
        self._seed, self._batch_size = config.seed, config.optimisation.batch_size
        training, validation = (
            sample_transitions(config, data, size, generator(config.seed, stream))
            for size, stream in (
                (data.training_samples, Stream.TRAINING_DATA),
                (data.validation_samples, Stream.VALIDATION_DATA),
            )
        )
        self.conditioning = state_conditioning(training)
        self.coverage = Coverage.only(config.system)
        self.uncertainty = CERTAIN
        self.description = "Rollouts of random controls, drawn from the prior, on this plant."
        self._training, self.validation = (
            prepare(transitions, self.conditioning, config.system, device)
            for transitions in (training, validation)
        )
        self._permutation = lru_cache(maxsize=1)(self._shuffle)

    def batch(self, step: int) -> Batch:
        """Return the next rows of the epoch's order."""
        epoch, batch = divmod(step, len(self._training) // self._batch_size)
        order = self._permutation(epoch)
        return self._training.rows(order[batch * self._batch_size : (batch + 1) * self._batch_size])

    def close(self) -> None:
        """Nothing is under way."""

    def _shuffle(self, epoch: int) -> IntArray:
        return generator(self._seed, Stream.SHUFFLE, epoch).permutation(len(self._training))


def prepare(
    transitions: Transitions, conditioning: Conditioning, system: System, device: torch.device
) -> Batch:
    """Scale the controls and standardise the states: c = [x_0, x_H] (paper, Eq. 2)."""
    columns: Any = (*transitions.initial_states.T, *transitions.terminal_states.T, system.plant)
    horizon = transitions.controls.shape[1]
    conditions = conditioning.encode_tasks(Task(*columns), horizon)
    controls = transitions.controls[:, None] / system.plant.highest_control
    return Batch(
        torch.tensor(controls, dtype=torch.float32, device=device),
        torch.from_numpy(conditions).to(device),
    )
