"""States and problems: what is none is refused."""

import math

import numpy as np
import pytest

from app.planning.problem import Problem, as_state


@pytest.mark.parametrize(
    "state", [[0.0], [0.0, 0.0, 0.0], [[0.0, 0.0]], [math.nan, 0.0], [0.0, math.inf]]
)
def test_what_is_not_two_finite_numbers_is_no_state(state: list[float]) -> None:
    with pytest.raises(ValueError, match="two finite numbers"):
        as_state(state)
    with pytest.raises(ValueError, match="two finite numbers"):
        Problem(np.zeros(2), np.array(state))


def test_a_horizon_of_no_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="horizon"):
        Problem(np.zeros(2), np.zeros(2), horizon=0)
