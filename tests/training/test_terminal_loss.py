import numpy as np
import pytest
import torch

from app.planning.arrays import FloatArray
from app.planning.plant.rollout import rollout
from training.machines import RandomMachines
from training.terminal_loss import SATURATION, TerminalLoss, terminal_loss_and_gradient

HORIZON = 16
TASKS = RandomMachines().sample(40, HORIZON, np.random.default_rng(0))
REACHES = np.asarray(TASKS.scales(HORIZON).reach)
CONTROLS = np.random.default_rng(1).uniform(-1, 1, (40, HORIZON))


def losses_of(
    controls: FloatArray, plants: FloatArray = TASKS.plants[:, np.newaxis]
) -> tuple[FloatArray, FloatArray]:
    return terminal_loss_and_gradient(controls, TASKS.states, plants, REACHES, SATURATION)


def test_the_loss_is_hubers_of_the_error_over_the_reach() -> None:
    losses, _ = losses_of(CONTROLS)

    for i, loss in enumerate(losses):
        problem = TASKS.problem(i, HORIZON)
        end = rollout(problem.system, problem.initial_state, CONTROLS[i : i + 1])[0, -1]
        error = np.linalg.norm(end - problem.target_state) / REACHES[i]
        huber = torch.nn.functional.huber_loss(
            torch.tensor(error), torch.tensor(0.0, dtype=torch.float64), delta=SATURATION
        )
        assert loss == pytest.approx(huber.item() / SATURATION)


def test_the_gradient_is_the_slope_of_the_loss() -> None:
    _, gradient = losses_of(CONTROLS)

    size = 1e-7
    for k in range(HORIZON):
        step = size * np.eye(HORIZON)[k]
        slope = (losses_of(CONTROLS + step)[0] - losses_of(CONTROLS - step)[0]) / (2 * size)
        np.testing.assert_allclose(gradient[:, k], slope, atol=1e-5)
    assert np.count_nonzero(gradient) > gradient.size / 2


def test_a_control_beyond_its_limit_is_pulled_back_and_never_pushed_out() -> None:
    beyond = 3.0 * np.sign(CONTROLS)

    losses, gradient = losses_of(beyond)

    np.testing.assert_array_equal(losses, losses_of(np.sign(CONTROLS))[0])
    assert np.all(gradient * beyond >= 0)
    assert np.any(gradient * beyond > 0)


def test_rows_without_a_condition_do_not_count() -> None:
    controls = torch.tensor(CONTROLS, requires_grad=True)
    keep = torch.arange(40) < 10

    loss = TerminalLoss.apply(controls, TASKS, keep, np.random.default_rng(2))  # type: ignore[no-untyped-call]
    loss.backward()

    losses, gradient = losses_of(CONTROLS)
    assert loss.item() == pytest.approx(losses[:10].sum() / 40)
    assert controls.grad is not None
    np.testing.assert_allclose(controls.grad[:10], gradient[:10] / 40)
    assert not controls.grad[10:].any()
