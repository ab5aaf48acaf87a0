"""At which diffusion times a sampler asks for predictions. No torch in here."""

import numpy as np

from app.planning.methods.base import InvalidStepCount

CLEAN = -1
"""The time after the last one, where no noise is left: the last of a model's noise levels."""


def diffusion_times(num_timesteps: int, steps: int, first: float, last: float) -> list[int]:
    """Return `steps` falling diffusion times, evenly spaced, then `CLEAN`.

    The ends of a cosine schedule may not be worth an evaluation. Near T there is hardly a signal:
    at T-1 an error in predicted noise is amplified a hundredfold in the clean sequence, and
    clamping is all that holds it. Near 0 hardly any noise is left to remove.

    Args:
        num_timesteps: T.
        steps: how many.
        first: where they begin, as a share of T; at 1 with T-1.
        last: where they end, the same.

    Raises:
        InvalidStepCount: there are fewer times than `steps` there, or none are asked for.
    """
    begin, end = (min(round(share * num_timesteps), num_timesteps - 1) for share in (first, last))
    available = begin - end + 1
    if not 1 <= steps <= available:
        raise InvalidStepCount(
            f"steps must be from 1 to {available}, the diffusion times that the model has for "
            "this sampler"
        )
    return [*np.linspace(begin, end, steps).round().astype(int).tolist(), CLEAN]
