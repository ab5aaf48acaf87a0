import numpy as np

from app.inference.checkpoint import Widths, parameter_shapes
from app.inference.kernel import arrange
from app.inference.kernel.weights import CACHE_LINE


def test_every_array_is_contiguous_float32_and_begins_with_a_cache_line() -> None:
    """Or else the kernel is right, but slower, by the luck of the allocator."""
    rng = np.random.default_rng(0)
    widths = Widths(channels=16, time_dimension=8, condition_dimension=8, condition_size=4)
    parameters = {
        name: rng.standard_normal(shape).astype(np.float32)
        for name, shape in parameter_shapes(widths).items()
    }

    for name, array in arrange(parameters)._asdict().items():
        assert array.dtype == np.float32, name
        assert array.flags.c_contiguous, name
        assert array.ctypes.data % CACHE_LINE == 0, name
