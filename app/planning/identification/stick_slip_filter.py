"""A Kalman filter through the stick-slip step: what is believed, and the prediction of a step.

The mass is either at rest or sliding, each with a probability and a Gaussian of its own (an
interacting multiple model filter, Blom and Bar-Shalom 1988); the modes pass into each other as the
friction law has it. How a measurement is taken into account is in measurement_update.py.
"""

import math
from typing import NamedTuple

from app.compilation import inlined
from app.planning.plant.friction import BREAKING_AWAY, STUCK, acceleration, take_step
from app.planning.plant.system import Plant

CERTAIN = 6.0
"""Standard deviations beyond which a mode does not pass into the other at all."""
LEAST_PROBABILITY = 1e-9
"""A mode of less is dropped."""
TINY = 1e-300
ROOT_HALF = math.sqrt(0.5)
LOG_2_PI = math.log(2.0 * math.pi)


class Mode(NamedTuple):
    """A way to be, at rest or sliding, with its probability and a Gaussian of the state."""

    probability: float
    position: float
    """Mean, m."""
    velocity: float
    """Mean, m/s; 0 at rest, and so are the next two."""
    position_variance: float
    covariance: float
    velocity_variance: float


class Belief(NamedTuple):
    """What is known of the state: either of these."""

    rest: Mode
    sliding: Mode


class Cut(NamedTuple):
    """A normal distribution of which only what is above zero is left."""

    probability: float
    mean: float
    variance: float


@inlined
def started(
    position: float, lag: float, position_noise: float, velocity: float, deviation: float
) -> Belief:
    """Return the belief of a mass that rests or slides, as likely the one as the other.

    Args:
        position: as measured, m.
        lag: s, how long before.
        position_noise: standard deviation of the measurement, m.
        velocity: m/s, roughly.
        deviation: m/s, how rough that is.
    """
    variance = position_noise * position_noise
    return Belief(
        Mode(0.5, position, 0.0, variance, 0.0, 0.0),
        Mode(
            0.5,
            position + lag * velocity,
            velocity,
            variance + lag * lag * deviation * deviation,
            lag * deviation * deviation,
            deviation * deviation,
        ),
    )


@inlined
def mean_state(belief: Belief) -> tuple[float, float]:
    """Return the mean position (m) and velocity (m/s)."""
    rest, sliding = belief.rest, belief.sliding
    position = rest.probability * rest.position + sliding.probability * sliding.position
    return position, sliding.probability * sliding.velocity


@inlined
def predict(belief: Belief, control: float, plant: Plant, noise: float) -> Belief:
    """Return the belief after one step under `control` (units of control).

    A random acceleration with standard deviation `noise` (m/s^2), constant over the step, acts
    beside the control: it, too, can set the mass off. Without it, and in a known state, the
    prediction is the plant's own step.
    """
    goes_on, stops = _slid(belief.sliding, control, plant, noise)
    rest = belief.rest
    if rest.probability == 0.0:
        return normalised(stops, goes_on)
    set_off = _set_off(rest, control, plant, noise)
    stays = Mode(
        rest.probability - set_off.probability, rest.position, 0.0, rest.position_variance, 0.0, 0.0
    )
    return normalised(_merged(stays, stops), _merged(set_off, goes_on))


@inlined
def _set_off(rest: Mode, control: float, plant: Plant, noise: float) -> Mode:
    """Return what of a mass at rest breaks away, forward or backward, whichever is nearer."""
    step = plant.time_step
    accelerated = acceleration(control, plant)
    direction, excess = 1.0, accelerated - plant.static_forward
    lead = plant.static_forward - plant.breakaway_forward
    if -accelerated - plant.static_backward > excess:
        direction, excess = -1.0, -accelerated - plant.static_backward
        lead = plant.static_backward - plant.breakaway_backward
    off = _cut(excess, noise * noise)
    velocity = direction * step * (off.mean + lead)
    velocity_variance = step * step * off.variance
    return Mode(
        rest.probability * off.probability,
        rest.position + step * velocity,
        velocity,
        rest.position_variance + step * step * velocity_variance,
        step * velocity_variance,
        velocity_variance,
    )


@inlined
def _slid(sliding: Mode, control: float, plant: Plant, noise: float) -> tuple[Mode, Mode]:
    """Return what of a sliding mass goes on, and what stops."""
    probability, position = sliding.probability, sliding.position
    taken = take_step(sliding.velocity, control, plant)
    if probability == 0.0 or taken.kind == STUCK:
        return (
            Mode(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            Mode(probability, position, 0.0, sliding.position_variance, 0.0, 0.0),
        )
    step, kept = plant.time_step, taken.free_by_velocity
    variance = kept * kept * sliding.velocity_variance + (step * noise) ** 2
    direction = taken.direction
    if taken.kind == BREAKING_AWAY:  # a creep may outlast a push against it, and does not stop
        direction = math.copysign(1.0, taken.free_velocity)
    free = direction * taken.free_velocity
    on = _cut(free, variance)
    if on.probability == 1.0:
        goes_on = Mode(
            probability,
            position + step * taken.free_velocity,
            taken.free_velocity,
            sliding.position_variance + step * (2.0 * kept * sliding.covariance + step * variance),
            kept * sliding.covariance + step * variance,
            variance,
        )
        return goes_on, Mode(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    # What the cut says of the velocity it says of the position, too.
    by_velocity = kept * sliding.covariance / max(variance, TINY)
    velocity = direction * on.mean
    covariance = by_velocity * on.variance
    position_variance = sliding.position_variance - by_velocity**2 * (variance - on.variance)
    goes_on = Mode(
        probability * on.probability,
        position + by_velocity * (velocity - taken.free_velocity) + step * velocity,
        velocity,
        position_variance + 2.0 * step * covariance + step * step * on.variance,
        covariance + step * on.variance,
        on.variance,
    )
    stopped = _cut(-free, variance)
    change = direction * (-stopped.mean - free)
    return goes_on, Mode(
        probability - goes_on.probability,
        position + by_velocity * change,
        0.0,
        sliding.position_variance - by_velocity**2 * (variance - stopped.variance),
        0.0,
        0.0,
    )


@inlined
def _cut(mean: float, variance: float) -> Cut:
    """Return what of a normal distribution lies above zero, by its moments."""
    deviation = math.sqrt(max(0.0, variance))  # rounding may leave it a little below zero
    if mean > CERTAIN * deviation:
        return Cut(1.0, mean, variance)
    if mean <= -CERTAIN * deviation:
        return Cut(0.0, 0.0, 0.0)
    ratio = mean / deviation
    probability = 0.5 * math.erfc(-ROOT_HALF * ratio)
    hazard = math.exp(-0.5 * (ratio * ratio + LOG_2_PI)) / probability
    left = max(0.0, 1.0 - hazard * (hazard + ratio))
    return Cut(probability, max(0.0, mean + hazard * deviation), left * variance)


@inlined
def _merged(one: Mode, other: Mode) -> Mode:
    """Return both as one, of the same mean and covariance."""
    if other.probability <= 0.0:
        return one
    if one.probability <= 0.0:
        return other
    probability = one.probability + other.probability
    share = other.probability / probability
    between = share * (1.0 - share)
    further, faster = other.position - one.position, other.velocity - one.velocity
    return Mode(
        probability,
        one.position + share * further,
        one.velocity + share * faster,
        _between(one.position_variance, other.position_variance, share)
        + between * further * further,
        _between(one.covariance, other.covariance, share) + between * further * faster,
        _between(one.velocity_variance, other.velocity_variance, share) + between * faster * faster,
    )


@inlined
def _between(one: float, other: float, share: float) -> float:
    return one + share * (other - one)


@inlined
def normalised(rest: Mode, sliding: Mode) -> Belief:
    """Return both with probabilities that add up to 1; what is as good as none is none."""
    if rest.probability == 0.0 and sliding.probability == 1.0:
        return Belief(rest, sliding)
    probability = rest.probability / (rest.probability + sliding.probability)
    if probability > 1.0 - LEAST_PROBABILITY:
        probability = 1.0
    elif probability < LEAST_PROBABILITY:
        probability = 0.0
    return Belief(of_probability(probability, rest), of_probability(1.0 - probability, sliding))


@inlined
def of_probability(probability: float, mode: Mode) -> Mode:
    """Return a mode with another probability."""
    return Mode(
        probability,
        mode.position,
        mode.velocity,
        mode.position_variance,
        mode.covariance,
        mode.velocity_variance,
    )
