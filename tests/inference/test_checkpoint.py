import pytest

from app.inference.checkpoint import (
    BLOCKS,
    LayoutMismatch,
    Shape,
    Widths,
    parameter_shapes,
    read_widths,
)
from app.inference.device import CPU
from app.inference.manifest import CHECKPOINT_FILE
from app.inference.torchscript import read_torchscript
from app.settings import SHIPPED_MODELS

WIDTHS = Widths(channels=16, time_dimension=12, condition_dimension=20, condition_size=7)


@pytest.fixture
def shapes() -> dict[str, Shape]:
    return parameter_shapes(WIDTHS)


def test_the_widths_are_read_from_the_shapes_that_follow_from_them(
    shapes: dict[str, Shape],
) -> None:
    assert read_widths(shapes) == WIDTHS


LINEAR = 2
"""Dimensions of the weights of a layer that convolves nothing."""


def test_the_shipped_checkpoints_have_this_layout() -> None:
    paper = Widths(channels=64, time_dimension=64, condition_dimension=64, condition_size=4)
    machines = Widths(channels=32, time_dimension=64, condition_dimension=256, condition_size=24)
    widths = {}
    for file in SHIPPED_MODELS.glob(f"*/*/{CHECKPOINT_FILE}"):
        state = read_torchscript(file.read_bytes(), CPU).state_dict()
        shapes = {name: tuple(weights.shape) for name, weights in state.items()}
        if len(shapes["input.weight"]) == LINEAR:
            continue  # of a residual MLP, no U-Net
        widths[file.parents[1].name] = read_widths(shapes)
    assert widths == {
        **{f"dry-friction-fs{friction}": paper for friction in (0.6, 0.7, 0.8)},
        "any-machine": machines,
        "any-machine-robust": machines._replace(condition_size=28),
    }


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("input.weight", (16, 1, 1, 5)),
        ("output.weight", (2, 16, 1, 3)),
        ("upsampling.weight", (16, 16, 1, 2)),
        (f"{BLOCKS[1]}.conv1.weight", (16, 16, 1, 5)),
        (f"{BLOCKS[5]}.condition_projection.weight", (1, 20)),
        ("time_embedding.frequencies", (12,)),
        ("attention.weight", (16, 16)),
    ],
)
def test_another_shape_or_one_parameter_more_is_refused_by_name(
    shapes: dict[str, Shape], name: str, shape: Shape
) -> None:
    with pytest.raises(LayoutMismatch, match=name):
        read_widths(shapes | {name: shape})


@pytest.mark.parametrize("name", parameter_shapes(WIDTHS))
def test_a_missing_parameter_is_refused_by_name(shapes: dict[str, Shape], name: str) -> None:
    del shapes[name]

    with pytest.raises(LayoutMismatch, match=name):
        read_widths(shapes)
