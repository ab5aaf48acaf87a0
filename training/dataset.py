"""The synthetic transitions that the model learns from (paper, Sect. 4.2)."""

from dataclasses import dataclass

import numpy as np
import torch

from app.inference.conditioning import Conditioning
from app.planning.arrays import FloatArray
from app.planning.plant.rollout import rollout
from training.config import TrainingConfig


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
    config: TrainingConfig, num_samples: int, rng: np.random.Generator
) -> Transitions:
    """Draw initial states uniformly and controls from the prior; roll them out."""
    position = rng.uniform(*config.data.position_range, num_samples)
    velocity = rng.uniform(*config.data.velocity_range, num_samples)
    initial_states = np.stack([position, velocity], axis=1)
    plant = config.system.plant
    controls = config.prior.sample(num_samples, config.data.horizon, plant, rng)
    terminal_states = rollout(config.system, initial_states, controls)[:, -1]
    return Transitions(controls, initial_states, terminal_states)


def state_conditioning(transitions: Transitions) -> Conditioning:
    """Return the paper's condition, standardised by initial and terminal states together."""
    states = np.concatenate([transitions.initial_states, transitions.terminal_states])
    return Conditioning.on_states(states.mean(axis=0).tolist(), states.std(axis=0).tolist())


@dataclass(frozen=True, slots=True)
class TrainingSet:
    """Transitions as the network sees them, float32, on the training device."""

    controls: torch.Tensor
    """(N, 1, H), scaled to [-1, 1]."""
    conditions: torch.Tensor
    """(N, 4): c = [x_0, x_H], standardised (paper, Eq. 2)."""

    @classmethod
    def prepare(
        cls,
        transitions: Transitions,
        conditioning: Conditioning,
        control_scale: float,
        device: torch.device,
    ) -> "TrainingSet":
        """Scale the controls, standardise the states."""
        states = np.hstack([transitions.initial_states, transitions.terminal_states])
        controls = transitions.controls[:, None] / control_scale
        return cls(
            torch.tensor(controls, dtype=torch.float32, device=device),
            torch.from_numpy(conditioning.standardise(states)).to(device),
        )
