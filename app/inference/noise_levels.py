"""How much signal and noise there is in a sequence at each diffusion time. No torch in here."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

ModelKind: TypeAlias = Literal["diffusion", "flow", "regression"]
"""What a model is. A *diffusion* is trained on u = signal * clean + noise * eps with squared shares
that add up to one; a *flow* on the same with shares that do so themselves (conditional flow
matching on straight paths, Lipman et al. 2023); a *regression* sees no noise, and answers with one
plan."""


class NoiseLevel(NamedTuple):
    """The shares of signal and noise in a sequence, and how fast they change towards the noise."""

    signal: float
    noise: float
    signal_rate: float
    noise_rate: float

    @property
    def log_ratio(self) -> float:
        """Lambda: half the logarithm of the signal-to-noise ratio."""
        return math.log(self.signal / self.noise)


def noise_levels(kind: ModelKind, alphas_cumprod: Sequence[float]) -> list[NoiseLevel]:
    """Return the level at each diffusion time, and last, at `CLEAN`, that without noise.

    Args:
        kind: of the model.
        alphas_cumprod: signal^2 / (signal^2 + noise^2) at each diffusion time.
    """
    of_kind = _straight if kind == "flow" else _preserving
    return [of_kind(alpha) for alpha in (*alphas_cumprod, 1.0)]


def _preserving(alpha: float) -> NoiseLevel:
    """Return a level that preserves the variance: on a circle, by its angle."""
    signal, noise = math.sqrt(alpha), math.sqrt(1 - alpha)
    return NoiseLevel(signal, noise, -noise, signal)


def _straight(alpha: float) -> NoiseLevel:
    """Return a level on the straight line from the clean sequence to the noise."""
    signal, noise = math.sqrt(alpha), math.sqrt(1 - alpha)
    total = signal + noise
    return NoiseLevel(signal / total, noise / total, -1.0, 1.0)
