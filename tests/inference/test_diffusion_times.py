from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.inference.diffusion_times import CLEAN, diffusion_times
from app.planning.methods.base import InvalidStepCount

ALL, MIDDLE = (1.0, 0.0), (0.7, 0.25)


@pytest.mark.parametrize("num_timesteps", [1, 2, 50, 200])
def test_times_fall_strictly_from_the_noisiest_to_clean_for_every_step_count(
    num_timesteps: int,
) -> None:
    for steps in range(1, num_timesteps + 1):
        times = diffusion_times(num_timesteps, steps, *ALL)

        assert len(times) == steps + 1
        assert times[0] == num_timesteps - 1
        assert times[-1] == CLEAN
        assert all(t > next_t for t, next_t in pairwise(times))


@given(st.integers(2, 2000).flatmap(lambda n: st.tuples(st.just(n), st.integers(2, n))))
def test_times_are_evenly_spaced_down_to_the_first(counts: tuple[int, int]) -> None:
    num_timesteps, steps = counts
    times = diffusion_times(num_timesteps, steps, *ALL)[:-1]

    assert times[-1] == 0
    gaps = [t - next_t for t, next_t in pairwise(times)]
    assert min(gaps) >= 1
    assert all(abs(gap - (num_timesteps - 1) / (steps - 1)) <= 1 for gap in gaps)


@pytest.mark.parametrize("steps", [0, -1, 201])
def test_a_step_count_that_the_model_does_not_have_is_refused(steps: int) -> None:
    with pytest.raises(InvalidStepCount, match="from 1 to 200"):
        diffusion_times(200, steps, *ALL)


def test_times_may_be_a_part_of_the_schedule() -> None:
    assert diffusion_times(200, 1, *MIDDLE) == [140, CLEAN]
    assert diffusion_times(200, 2, *MIDDLE) == [140, 50, CLEAN]
    assert diffusion_times(200, 4, *MIDDLE) == [140, 110, 80, 50, CLEAN]
    assert diffusion_times(1000, 3, *MIDDLE) == [700, 475, 250, CLEAN]
    assert diffusion_times(200, 2, 1.0, 0.5) == [199, 100, CLEAN]


@pytest.mark.parametrize(
    ("num_timesteps", "available"), [(1, 1), (2, 2), (3, 2), (4, 3), (20, 10), (50, 24), (200, 91)]
)
def test_times_of_a_part_fall_strictly_for_every_step_count_and_others_are_refused(
    num_timesteps: int, available: int
) -> None:
    for steps in range(1, available + 1):
        times = diffusion_times(num_timesteps, steps, *MIDDLE)

        assert len(times) == steps + 1
        assert times[-1] == CLEAN
        assert num_timesteps > times[0] >= times[-2] >= 0
        assert all(t > next_t for t, next_t in pairwise(times))
    for steps in (-1, 0, available + 1):
        with pytest.raises(InvalidStepCount, match=f"from 1 to {available}, "):
            diffusion_times(num_timesteps, steps, *MIDDLE)
