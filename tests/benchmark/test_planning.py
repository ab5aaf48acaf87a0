"""The benchmark's NumPy reference is the kernel's equal, so that their ratio means something."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.benchmark.planning import numpy_rollout
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 1.5), st.floats(-1, 1))
def test_the_reference_rolls_out_like_the_kernel(seed: int, limit: float, velocity: float) -> None:
    system = System(control_limit=limit)
    controls = np.random.default_rng(seed).uniform(-limit, limit, (8, 40))
    start = np.array([0.1, velocity])
    expected = rollout(system, start, controls)
    np.testing.assert_allclose(numpy_rollout(system, start, controls), expected, atol=1e-12)
