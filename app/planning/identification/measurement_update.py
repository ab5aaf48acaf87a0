"""What a measurement does to the belief of the stick-slip filter, and how likely it was.

Both modes are corrected, each as a Kalman filter does, and weighed by how likely they made it.
"""

import math

from app.compilation import inlined
from app.planning.identification.stick_slip_filter import (
    LOG_2_PI,
    Belief,
    Mode,
    normalised,
    of_probability,
)

OUTLIER = 25.0
"""Squared innovations, in variances, above which they count less and less (they grow with the
logarithm): one wrong sample must not outweigh a thousand."""


@inlined
def update_position(
    belief: Belief, measured: float, noise: float, lag: float
) -> tuple[Belief, float]:
    """Return the belief once a position was measured, and the measurement's log-likelihood.

    Args:
        belief: before.
        measured: m, where the mass was `lag` ago at its velocity of now.
        noise: standard deviation of the measurement, m.
        lag: s.
    """
    rest, rest_likely = _at_position(belief.rest, measured, noise, lag)
    sliding, sliding_likely = _at_position(belief.sliding, measured, noise, lag)
    return _weighed(rest, rest_likely, sliding, sliding_likely)


@inlined
def update_velocity(belief: Belief, measured: float, noise: float) -> tuple[Belief, float]:
    """Return the belief once a velocity was measured, and the measurement's log-likelihood.

    Args:
        belief: before.
        measured: m/s.
        noise: standard deviation of the measurement, m/s.
    """
    rest, rest_likely = _at_velocity(belief.rest, measured, noise)
    sliding, sliding_likely = _at_velocity(belief.sliding, measured, noise)
    return _weighed(rest, rest_likely, sliding, sliding_likely)


@inlined
def _at_position(mode: Mode, measured: float, noise: float, lag: float) -> tuple[Mode, float]:
    """Return a mode once a position was measured, and the measurement's log-likelihood."""
    if mode.probability == 0.0:
        return mode, 0.0
    # Covariances of position and velocity with what is measured, before its noise.
    of_position = mode.position_variance - lag * mode.covariance
    of_velocity = mode.covariance - lag * mode.velocity_variance
    variance = of_position - lag * of_velocity + noise * noise
    innovation = measured - (mode.position - lag * mode.velocity)
    inverse = 1.0 / variance
    gain, gain_of_velocity = of_position * inverse, of_velocity * inverse
    left = mode.velocity_variance - gain_of_velocity * of_velocity
    return (
        Mode(
            mode.probability,
            mode.position + gain * innovation,
            mode.velocity + gain_of_velocity * innovation,
            gain * noise * noise + lag * (mode.covariance - gain * of_velocity),
            gain_of_velocity * noise * noise + lag * left,
            left,
        ),
        _log_density(innovation * innovation * inverse, variance),
    )


@inlined
def _at_velocity(mode: Mode, measured: float, noise: float) -> tuple[Mode, float]:
    """Return a mode once a velocity was measured, and the measurement's log-likelihood."""
    if mode.probability == 0.0:
        return mode, 0.0
    variance = mode.velocity_variance + noise * noise
    innovation = measured - mode.velocity
    inverse = 1.0 / variance
    gain, gain_of_position = mode.velocity_variance * inverse, mode.covariance * inverse
    return (
        Mode(
            mode.probability,
            mode.position + gain_of_position * innovation,
            mode.velocity + gain * innovation,
            mode.position_variance - gain_of_position * mode.covariance,
            gain_of_position * noise * noise,
            gain * noise * noise,
        ),
        _log_density(innovation * innovation * inverse, variance),
    )


@inlined
def _log_density(square: float, variance: float) -> float:
    """Return the logarithm of a normal density, with heavier tails far out."""
    if square > OUTLIER:
        square = OUTLIER * (1.0 + math.log(square / OUTLIER))
    return -0.5 * (math.log(variance) + square + LOG_2_PI)


@inlined
def _weighed(
    rest: Mode, rest_likely: float, sliding: Mode, sliding_likely: float
) -> tuple[Belief, float]:
    """Weigh both modes by how likely they made the measurement; say how likely both together do."""
    if rest.probability == 0.0:
        return Belief(rest, sliding), sliding_likely
    if sliding.probability == 0.0:
        return Belief(rest, sliding), rest_likely
    most = max(rest_likely, sliding_likely)
    at_rest = rest.probability * math.exp(rest_likely - most)
    in_motion = sliding.probability * math.exp(sliding_likely - most)
    belief = normalised(of_probability(at_rest, rest), of_probability(in_motion, sliding))
    return belief, most + math.log(at_rest + in_motion)
