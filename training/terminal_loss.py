"""The terminal loss: where a predicted plan ends, by the true dynamics, counts as well.

Of a machine that is not known exactly it is the mean over a few plants that it may be.
"""

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.sensitivity import linearise
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from training.tasks import Tasks
from training.uncertainty import plants_within

SATURATION = 0.02
"""Share of the reach: beyond it the loss grows with the error, not with its square (Huber)."""


class TerminalLoss(torch.autograd.Function):
    """The mean over B rows of `terminal_loss_and_gradient`; rows without a condition count as 0."""

    @staticmethod
    def forward(
        ctx: Any, controls: Tensor, tasks: Tasks, keep: Tensor, rng: np.random.Generator
    ) -> Tensor:
        """Roll out the predicted clean controls (B, H); keep (B,) says which rows count.

        The plants that machines may be are drawn from `rng`.
        """
        losses, gradient = terminal_loss_and_gradient(
            controls.detach().cpu().double().numpy(),
            tasks.states,
            plants_within(tasks, rng),
            np.asarray(tasks.scales(controls.shape[1]).reach),
            SATURATION,
        )
        weights = keep / len(keep)
        ctx.save_for_backward(torch.from_numpy(gradient).to(controls) * weights[:, None])
        return torch.sum(torch.from_numpy(losses).to(controls) * weights)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, None, None, None]:
        """Return the gradient by the controls."""
        (gradient,) = ctx.saved_tensors
        return slope * gradient, None, None, None


@compiled
def terminal_loss_and_gradient(
    controls: FloatArray,
    states: FloatArray,
    plants: FloatArray,
    reaches: FloatArray,
    saturation: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the Huber loss of the terminal error over the reach, and its exact gradient.

    Both are means over S plants. No step is smoothed: the gradient is zero where the mass is stuck.
    The controls are clamped, and no gradient pushes one further out of its limits.

    Args:
        controls: (N, H), for machines with gain 1 and limits -1 and 1.
        states: (N, 4), as in `Tasks`.
        plants: (N, S, 15), the fields of `Plant`: what each machine may be.
        reaches: (N,), what an error is measured by.
        saturation: where the loss turns from the error's square to the error.

    Returns:
        (N,), (N, H).
    """
    size, horizon = controls.shape
    num_plants = plants.shape[1]
    losses, gradient = np.zeros(size), np.zeros((size, horizon))
    clamped, jacobian = np.empty(horizon), np.empty((2, horizon))
    for i in range(size):
        for k in range(horizon):
            clamped[k] = min(1.0, max(-1.0, controls[i, k]))
        for s in range(num_plants):
            plant = _plant(plants[i, s])
            task = Task(states[i, 0], states[i, 1], states[i, 2], states[i, 3], plant)
            position, velocity = linearise(clamped, task, jacobian)
            by_position = (position - task.target_position) / reaches[i]
            by_velocity = (velocity - task.target_velocity) / reaches[i]
            error = math.hypot(by_position, by_velocity)
            loss = error - 0.5 * saturation
            if error < saturation:
                loss = 0.5 * error * error / saturation
            losses[i] += loss / num_plants
            slope = 1.0 / (max(error, saturation) * reaches[i] * num_plants)
            for k in range(horizon):
                g = by_position * jacobian[0, k] + by_velocity * jacobian[1, k]
                gradient[i, k] += slope * g
        for k in range(horizon):
            if abs(controls[i, k]) > 1.0 and gradient[i, k] * controls[i, k] < 0.0:
                gradient[i, k] = 0.0
    return losses, gradient


@compiled
def _plant(fields: FloatArray) -> Plant:
    return Plant(
        fields[0], fields[1], fields[2], fields[3], fields[4], fields[5], fields[6], fields[7],
        fields[8], fields[9], fields[10], fields[11], fields[12], fields[13], fields[14],
    )  # fmt: skip
