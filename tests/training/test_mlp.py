import pytest
import torch

from app.inference.device import CPU
from app.inference.torchscript import read_torchscript, to_torchscript
from training.config import MLPConfig
from training.mlp import MLP

HORIZON = 16
CONFIG = MLPConfig(kind="mlp", width=32, blocks=2, time_dimension=8)


@pytest.fixture
def mlp() -> MLP:
    torch.manual_seed(0)
    return MLP(CONFIG, condition_size=5, horizon=HORIZON).eval()


def inputs(rows: int) -> tuple[torch.Tensor, ...]:
    generator = torch.Generator().manual_seed(rows)
    return (
        torch.randn(rows, 1, HORIZON, generator=generator),
        torch.randint(200, (rows,), generator=generator),
        torch.randn(rows, 5, generator=generator),
        torch.ones(rows, dtype=torch.bool),
    )


@torch.inference_mode()
def test_rows_have_nothing_to_do_with_each_other(mlp: MLP) -> None:
    together = mlp(*inputs(6))

    assert together.shape == (6, 1, HORIZON)
    for row in range(6):
        alone = mlp(*(part[row : row + 1] for part in inputs(6)))
        torch.testing.assert_close(alone, together[row : row + 1])


@torch.inference_mode()
def test_each_argument_counts(mlp: MLP) -> None:
    u_t, t, condition, keep = inputs(1)
    expected = mlp(u_t, t, condition, keep)

    for changed in ((u_t + 1, t, condition, keep), (u_t, t + 50, condition, keep),
                    (u_t, t, condition + 1, keep), (u_t, t, condition, ~keep)):  # fmt: skip
        assert not torch.allclose(mlp(*changed), expected)


@torch.inference_mode()
def test_without_a_condition_its_numbers_do_not_count(mlp: MLP) -> None:
    u_t, t, condition, keep = inputs(3)

    without = mlp(u_t, t, condition, ~keep)

    assert torch.equal(mlp(u_t, t, condition + 1, ~keep), without)
    # Nor is it the condition of zeros.
    assert not torch.allclose(mlp(u_t, t, torch.zeros_like(condition), keep), without)


@torch.inference_mode()
def test_the_exported_file_predicts_the_same(mlp: MLP) -> None:
    script = read_torchscript(to_torchscript(mlp), CPU)

    torch.testing.assert_close(script(*inputs(4)), mlp(*inputs(4)))
