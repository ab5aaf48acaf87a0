from itertools import pairwise

import pytest
import torch
from torch import Tensor, nn

from app.inference.checkpoint import Widths, parameter_shapes
from app.inference.device import CPU
from app.inference.torchscript import read_torchscript, to_torchscript
from training.config import UNetConfig
from training.unet import UNet, conv1d

PAPER = UNetConfig(kind="unet", channels=64, time_dimension=64, condition_dimension=64)
TINY = UNetConfig(kind="unet", channels=8, time_dimension=16, condition_dimension=24)

Inputs = tuple[Tensor, Tensor, Tensor, Tensor]


def network(config: UNetConfig = TINY) -> UNet:
    torch.manual_seed(0)
    return UNet(config, condition_size=4).eval()


def inputs(rows: int, horizon: int = 64, keep: bool = True) -> Inputs:
    generator = torch.Generator().manual_seed(rows)
    return (
        torch.randn(rows, 1, horizon, generator=generator),
        torch.randint(200, (rows,), generator=generator),
        torch.randn(rows, 4, generator=generator),
        torch.full((rows,), keep),
    )


def test_the_layers_have_the_shapes_of_the_paper() -> None:
    unet = network(PAPER)
    shapes: dict[str, tuple[int, ...]] = {}
    for name, layer in unet.named_children():

        def record(_: nn.Module, __: object, output: Tensor, name: str = name) -> None:
            # The height of one that the 2-D form adds is no part of the shape.
            shapes[name] = tuple(size for size in output.shape[1:] if size != 1)

        layer.register_forward_hook(record)

    with torch.inference_mode():
        noise = unet(*inputs(3))

    assert noise.shape == (3, 1, 64)
    assert list(shapes.items()) == [
        ("time_embedding", (64,)),
        ("condition_embedding", (64,)),
        ("input", (64, 64)),
        ("encoder1", (64, 64)),
        ("encoder2", (64, 64)),
        ("downsampling", (64, 32)),
        ("bottleneck1", (64, 32)),
        ("bottleneck2", (64, 32)),
        ("upsampling", (64, 64)),
        ("decoder1", (64, 64)),
        ("decoder2", (64, 64)),
        ("output", (64,)),
    ]


def test_the_number_of_parameters_is_that_of_the_papers_table() -> None:
    convolutions = (3 * 64 + 64) + (4 * 64 * 64 + 64) + (4 * 64 * 64 + 64) + (3 * 64 + 1)
    norms, kernels, projections = 2 * 2 * 64, 2 * (3 * 64 * 64 + 64), 2 * (64 * 64 + 64)
    time_embedding = 2 * (64 * 64 + 64)
    condition_embedding = (4 * 64 + 64) + (64 * 64 + 64) + 64  # the last 64: the null condition

    total = sum(parameter.numel() for parameter in UNet(PAPER, condition_size=4).parameters())

    blocks = 6 * (norms + kernels + projections)
    assert total == convolutions + blocks + time_embedding + condition_embedding == 245_889


@pytest.mark.parametrize("condition_size", [4, 9])
def test_the_parameters_are_those_of_the_checkpoints_layout(condition_size: int) -> None:
    state = UNet(TINY, condition_size).state_dict()

    assert {name: tuple(tensor.shape) for name, tensor in state.items()} == parameter_shapes(
        Widths(channels=8, time_dimension=16, condition_dimension=24, condition_size=condition_size)
    )


@pytest.mark.parametrize("horizon", [4, 16, 32, 64])
@pytest.mark.parametrize("rows", [1, 5])
def test_the_noise_has_the_shape_of_the_controls(horizon: int, rows: int) -> None:
    with torch.inference_mode():
        assert network()(*inputs(rows, horizon)).shape == (rows, 1, horizon)


@pytest.mark.parametrize(("kernel", "stride"), [(3, 1), (4, 2)])
def test_the_two_dimensional_form_computes_a_conv1d(kernel: int, stride: int) -> None:
    torch.manual_seed(0)
    layer = conv1d(3, 5, kernel, stride)
    x = torch.randn(2, 3, 20)

    assert layer.bias is not None
    expected = nn.functional.conv1d(x, layer.weight.squeeze(2), layer.bias, stride, padding=1)
    torch.testing.assert_close(layer(x.unsqueeze(2)).squeeze(2), expected)
    assert expected.shape == (2, 5, 20 // stride)


def test_a_dropped_condition_leaves_no_trace_of_the_states() -> None:
    unet = network()
    u, t, condition, drop = inputs(4, keep=False)
    keep = ~drop

    with torch.inference_mode():
        assert torch.equal(unet(u, t, condition, drop), unet(u, t, condition + 1, drop))
        assert not torch.equal(unet(u, t, condition, keep), unet(u, t, condition + 1, keep))
        assert not torch.equal(unet(u, t, condition, keep), unet(u, t, condition, drop))


@pytest.mark.parametrize("component", range(4))
def test_every_component_of_the_condition_matters(component: int) -> None:
    unet = network()
    u, t, condition, keep = inputs(4)
    changed = condition.clone()
    changed[:, component] += 1

    with torch.inference_mode():
        assert not torch.allclose(unet(u, t, condition, keep), unet(u, t, changed, keep))


def test_the_diffusion_time_matters() -> None:
    unet = network()
    u, _, condition, keep = inputs(1)

    with torch.inference_mode():
        noises = [unet(u, torch.tensor([t]), condition, keep) for t in (0, 1, 100, 101, 198, 199)]

    assert all(not torch.allclose(a, b) for a, b in pairwise(noises))


def test_the_null_condition_is_learned_from_the_rows_without_a_condition_alone() -> None:
    unet = network()
    null = unet.condition_embedding.null

    for keep in (True, False):
        unet.zero_grad(set_to_none=True)
        unet(*inputs(4, keep=keep)).square().sum().backward()

        reached = null.grad is not None and bool(null.grad.abs().sum() > 0)
        assert reached == (not keep)


def test_every_parameter_is_trained() -> None:
    unet = network()
    u, t, condition, _ = inputs(4)
    keep = torch.tensor([True, False, True, False])

    unet(u, t, condition, keep).square().sum().backward()

    for name, parameter in unet.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name


def test_rows_are_independent_of_one_another() -> None:
    unet = network()
    batch = inputs(6)
    batch[3][::2] = False

    with torch.inference_mode():
        together = unet(*batch)
        for row in range(6):
            alone = unet(*(part[row : row + 1] for part in batch))
            torch.testing.assert_close(together[row : row + 1], alone, rtol=0, atol=1e-5)


def test_the_exported_network_answers_as_the_original() -> None:
    unet = network()
    script = read_torchscript(to_torchscript(unet), CPU)

    with torch.inference_mode():
        for rows, horizon in [(1, 64), (2, 64), (33, 64), (1, 32), (7, 32), (128, 16)]:
            batch = inputs(rows, horizon)
            batch[3][::2] = False
            # More than once: the executor rewrites the graph after the first calls.
            for _ in range(3):
                torch.testing.assert_close(script(*batch), unet(*batch), rtol=0, atol=1e-5)


def test_the_exported_file_does_not_change_the_network() -> None:
    unet = network()
    batch = inputs(3)
    with torch.inference_mode():
        before = unet(*batch)
        to_torchscript(unet)

        assert torch.equal(unet(*batch), before)
