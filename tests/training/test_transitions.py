from collections.abc import Callable

import numpy as np
import pytest
import torch

from app.inference.conditioning import Conditioning
from app.inference.device import CPU
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from training.config import TrainingConfig, TransitionsConfig
from training.transitions import (
    TransitionData,
    Transitions,
    prepare,
    sample_transitions,
    state_conditioning,
)


@pytest.fixture(scope="module")
def config(configure: Callable[..., TrainingConfig]) -> TrainingConfig:
    return configure(
        system={"static_friction": 0.5, "coulomb_friction": 0.4, "control_limit": 1.5},
        data={"position_range": [-0.5, 1.0], "velocity_range": [-0.2, 0.4]},
    )


def sample(config: TrainingConfig, size: int, seed: int) -> Transitions:
    assert isinstance(config.data, TransitionsConfig)
    return sample_transitions(config, config.data, size, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def transitions(config: TrainingConfig) -> Transitions:
    return sample(config, 2000, 0)


def test_terminal_states_are_what_the_plant_reaches(
    config: TrainingConfig, transitions: Transitions
) -> None:
    states = rollout(config.system, transitions.initial_states, transitions.controls)

    assert transitions.controls.shape == (2000, 16)
    np.testing.assert_array_equal(transitions.terminal_states, states[:, -1])


def test_initial_states_are_uniform_over_their_ranges(transitions: Transitions) -> None:
    position, velocity = transitions.initial_states.T

    np.testing.assert_allclose(
        np.quantile(position, [0, 0.25, 0.5, 0.75, 1]), [-0.5, -0.125, 0.25, 0.625, 1], atol=0.06
    )
    np.testing.assert_allclose(
        np.quantile(velocity, [0, 0.25, 0.5, 0.75, 1]), [-0.2, -0.05, 0.1, 0.25, 0.4], atol=0.03
    )
    assert abs(np.corrcoef(position, velocity)[0, 1]) < 0.08


def test_controls_come_from_the_configured_prior_within_the_limit(
    configure: Callable[..., TrainingConfig],
) -> None:
    loud = configure(prior={"kick_probability": 1.0, "medium_probability": 0.0})
    loud_controls = sample(loud, 500, 0).controls
    quiet = configure(prior={"kick_probability": 0.0, "medium_probability": 0.0})
    quiet_controls = sample(quiet, 500, 0).controls

    assert np.max(np.abs(loud_controls)) == pytest.approx(0.9, rel=0.01)
    assert np.max(np.abs(quiet_controls)) <= 0.15 * 0.9


def test_the_generator_decides_the_transitions(config: TrainingConfig) -> None:
    first, again, other = (sample(config, 20, seed) for seed in (1, 1, 2))

    np.testing.assert_array_equal(first.controls, again.controls)
    np.testing.assert_array_equal(first.terminal_states, again.terminal_states)
    assert not np.array_equal(first.controls, other.controls)
    assert not np.array_equal(first.initial_states, other.initial_states)


def test_states_are_standardised_over_starts_and_ends_together() -> None:
    transitions = Transitions(
        controls=np.zeros((2, 4)),
        initial_states=np.array([[0.0, 1.0], [2.0, 1.0]]),
        terminal_states=np.array([[4.0, 3.0], [6.0, 3.0]]),
    )

    conditioning = state_conditioning(transitions)

    np.testing.assert_allclose(conditioning.mean, [3.0, 2.0, 3.0, 2.0])
    np.testing.assert_allclose(conditioning.std, [np.sqrt(5.0), 1.0, np.sqrt(5.0), 1.0])


def test_the_network_sees_scaled_controls_and_start_then_end_standardised() -> None:
    transitions = Transitions(
        controls=np.array([[0.9, -0.9, 0.45]]),
        initial_states=np.array([[1.0, 2.0]]),
        terminal_states=np.array([[5.0, -2.0]]),
    )
    conditioning = Conditioning.on_states([1.0, 0.0], [2.0, 4.0])

    prepared = prepare(transitions, conditioning, System(), CPU)

    torch.testing.assert_close(prepared.controls, torch.tensor([[[1.0, -1.0, 0.5]]]))
    torch.testing.assert_close(prepared.conditions, torch.tensor([[0.0, 0.5, 2.0, -0.5]]))


def test_a_prepared_set_is_standard_and_bounded(
    config: TrainingConfig, transitions: Transitions
) -> None:
    prepared = prepare(transitions, state_conditioning(transitions), config.system, CPU)

    assert prepared.controls.shape == (2000, 1, 16)
    assert prepared.controls.dtype == prepared.conditions.dtype == torch.float32
    assert prepared.controls.abs().max() <= 1
    states = prepared.conditions.reshape(-1, 2)
    torch.testing.assert_close(states.mean(dim=0), torch.zeros(2), rtol=0, atol=1e-5)
    torch.testing.assert_close(states.std(dim=0, correction=0), torch.ones(2), rtol=0, atol=1e-4)


def test_an_epoch_takes_every_row_once_and_the_next_one_in_another_order(
    config: TrainingConfig,
) -> None:
    assert isinstance(config.data, TransitionsConfig)
    data = TransitionData(config, config.data, CPU)

    # 100 samples make three batches of 32.
    epochs = [torch.cat([data.batch(3 * epoch + i).controls for i in range(3)]) for epoch in (0, 1)]

    for epoch in epochs:
        assert len(torch.unique(epoch, dim=0)) == 96
    assert not torch.equal(*epochs)
    assert torch.equal(data.batch(4).controls, epochs[1][32:64])
