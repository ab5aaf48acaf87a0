"""The layout of a checkpoint: its parameters by name and shape (paper, Table 1).

Everybody who reads or writes the network's weights takes names and sizes from here.
"""

from collections.abc import Mapping
from itertools import chain
from typing import NamedTuple, TypeAlias

GROUPS = 8
"""Of every GroupNorm."""
BLOCKS = ("encoder1", "encoder2", "bottleneck1", "bottleneck2", "decoder1", "decoder2")
"""The residual blocks in the order in which a row passes them."""

Shape: TypeAlias = tuple[int, ...]


class Widths(NamedTuple):
    """The sizes from which all shapes follow."""

    channels: int
    """C, of every convolution."""
    time_dimension: int
    condition_dimension: int
    """Of the two embeddings."""
    condition_size: int
    """Numbers of a condition."""


class LayoutMismatch(ValueError):
    """The parameters are not those of Table 1."""


def parameter_shapes(widths: Widths) -> dict[str, Shape]:
    """Return the shape of every parameter and buffer; convolutions are in 2-D form."""
    channels, time, condition, size = widths
    shapes: dict[str, Shape] = {
        "time_embedding.frequencies": (time // 2,),
        **_mlp("time_embedding", time, time),
        **_mlp("condition_embedding", size, condition),
        "condition_embedding.null": (condition,),
        **_layer("input", channels, 1, 1, 3),
        **_layer("downsampling", channels, channels, 1, 4),
        **_layer("upsampling", channels, channels, 1, 4),
        **_layer("output", 1, channels, 1, 3),
    }
    for block in BLOCKS:
        for half in (1, 2):
            shapes |= _layer(f"{block}.norm{half}", channels)
            shapes |= _layer(f"{block}.conv{half}", channels, channels, 1, 3)
        shapes |= _layer(f"{block}.time_projection", channels, time)
        shapes |= _layer(f"{block}.condition_projection", channels, condition)
    return shapes


def read_widths(shapes: Mapping[str, Shape]) -> Widths:
    """Return the widths of the network whose parameters have these shapes.

    Raises:
        LayoutMismatch: a parameter is missing, is one too many, or has another shape.
    """
    try:
        widths = Widths(
            channels=shapes["input.bias"][0],
            time_dimension=shapes["time_embedding.mlp.0.bias"][0],
            condition_dimension=shapes["condition_embedding.null"][0],
            condition_size=shapes["condition_embedding.mlp.0.weight"][1],
        )
    except LookupError as error:
        raise LayoutMismatch(f"its layers are not those of Table 1 ({error})") from error
    expected = parameter_shapes(widths)
    for name in dict.fromkeys(chain(expected, shapes)):
        if expected.get(name) != shapes.get(name):
            raise LayoutMismatch(
                f"its layers are not those of Table 1: {name} is {shapes.get(name, 'missing')}, "
                f"not {expected.get(name, 'a parameter')}"
            )
    return widths


def _mlp(name: str, size: int, dimension: int) -> dict[str, Shape]:
    """Return two linear layers with an activation between them."""
    return {
        **_layer(f"{name}.mlp.0", dimension, size),
        **_layer(f"{name}.mlp.2", dimension, dimension),
    }


def _layer(name: str, *weight: int) -> dict[str, Shape]:
    """Return a weight of that shape, and a bias as long as its first axis."""
    return {f"{name}.weight": weight, f"{name}.bias": weight[:1]}
