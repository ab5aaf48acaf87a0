"""A Kalman filter through the stick-slip step: one prediction, one update.

The mass is either at rest or sliding, each with a probability and a Gaussian of its own (an
interacting multiple model filter, Blom and Bar-Shalom 1988); the modes pass into each other as the
friction law has it. Nothing here knows a log, or what the likelihood is for.
"""

import math
from typing import NamedTuple

from app.compilation import compiled
from app.planning.plant.friction import STUCK, acceleration, take_step
from app.planning.plant.system import Plant

CERTAIN = 6.0
"""Standard deviations beyond which a mode does not pass into the other at all."""
LEAST_PROBABILITY = 1e-9
"""A mode of less is dropped."""
TINY = 1e-300
ROOT_HALF = math.sqrt(0.5)
LOG_2_PI = math.log(2.0 * math.pi)
OUTLIER = 25.0
"""Squared innovations, in variances, above which they count less and less (they grow with the
logarithm): one wrong sample must not outweigh a thousand."""


class Belief(NamedTuple):
    """What is known of the state: with a probability the mass rests, or else it slides."""

    rest: float
    """Probability that the mass is at rest."""
    rest_position: float
    """Mean where it rests, m."""
    rest_variance: float
    """Of that position, m^2."""
    position: float
    """Mean where it slides, m."""
    velocity: float
    """Mean where it slides, m/s."""
    position_variance: float
    covariance: float
    velocity_variance: float


class Cut(NamedTuple):
    """A normal distribution of which only what is above zero is left."""

    probability: float
    mean: float
    variance: float


@compiled
def cut_at_zero(mean: float, variance: float) -> Cut:
    """Return what of a normal distribution lies above zero, by its moments."""
    deviation = math.sqrt(variance)
    if mean > CERTAIN * deviation:
        return Cut(1.0, mean, variance)
    if mean <= -CERTAIN * deviation:
        return Cut(0.0, 0.0, 0.0)
    ratio = mean / deviation
    probability = 0.5 * math.erfc(-ROOT_HALF * ratio)
    hazard = math.exp(-0.5 * (ratio * ratio + LOG_2_PI)) / probability
    left = max(0.0, 1.0 - hazard * (hazard + ratio))
    return Cut(probability, max(0.0, mean + hazard * deviation), left * variance)


@compiled
def predict(belief: Belief, control: float, plant: Plant, noise: float) -> Belief:
    """Return the belief after one step under `control` (units of control).

    A random acceleration with standard deviation `noise` (m/s^2), constant over the step, acts
    beside the control: it, too, can set the mass off. Without it, and in a known state, the
    prediction is the plant's own step.
    """
    step = plant.time_step
    accelerated = acceleration(control, plant)
    rests, rest_position, rest_variance = 0.0, 0.0, 0.0
    slides, position, velocity = 0.0, 0.0, 0.0
    position_variance, covariance, velocity_variance = 0.0, 0.0, 0.0
    if belief.rest > 0.0:
        # Forward or backward, whichever is nearer to breaking away.
        direction, excess = 1.0, accelerated - plant.static_forward
        lead = plant.static_forward - plant.breakaway_forward
        if -accelerated - plant.static_backward > excess:
            direction, excess = -1.0, -accelerated - plant.static_backward
            lead = plant.static_backward - plant.breakaway_backward
        off = cut_at_zero(excess, noise * noise)
        slides = belief.rest * off.probability
        if slides > 0.0:
            velocity = direction * step * (off.mean + lead)
            velocity_variance = step * step * off.variance
            position = belief.rest_position + step * velocity
            covariance = step * velocity_variance
            position_variance = belief.rest_variance + step * covariance
        rests = belief.rest - slides
        rest_position, rest_variance = belief.rest_position, belief.rest_variance
    if belief.rest < 1.0:
        sliding = 1.0 - belief.rest
        taken = take_step(belief.velocity, control, plant)
        if taken.kind == STUCK:
            goes_on = 0.0
            stopped_position, stopped_variance = belief.position, belief.position_variance
        else:
            kept = taken.free_by_velocity
            variance = kept * kept * belief.velocity_variance + (step * noise) ** 2
            free = taken.direction * taken.free_velocity
            on = cut_at_zero(free, variance)
            goes_on = sliding * on.probability
            by_velocity = kept * belief.covariance / max(variance, TINY)
            stopped_position, stopped_variance = belief.position, belief.position_variance
            if 0.0 < on.probability < 1.0:
                stopped = cut_at_zero(-free, variance)
                change = -stopped.mean - free
                stopped_position += by_velocity * taken.direction * change
                stopped_variance -= by_velocity**2 * (variance - stopped.variance)
            if goes_on > 0.0:
                v = taken.direction * on.mean
                vv = on.variance
                p = belief.position + by_velocity * (v - taken.free_velocity) + step * v
                pv = by_velocity * vv
                pp = belief.position_variance - by_velocity**2 * (variance - vv)
                pp += 2.0 * step * pv + step * step * vv
                pv += step * vv
                # Two ways to slide become one, of the same moments.
                share = goes_on / (slides + goes_on)
                dp, dv = p - position, v - velocity
                between = share * (1.0 - share)
                position_variance += share * (pp - position_variance) + between * dp * dp
                covariance += share * (pv - covariance) + between * dp * dv
                velocity_variance += share * (vv - velocity_variance) + between * dv * dv
                position += share * dp
                velocity += share * dv
                slides += goes_on
        stops = sliding - goes_on
        if stops > 0.0:
            share = stops / (rests + stops)
            dp = stopped_position - rest_position
            rest_variance += share * (stopped_variance - rest_variance)
            rest_variance += share * (1.0 - share) * dp * dp
            rest_position += share * dp
            rests += stops
    rest = rests / (rests + slides)
    return Belief(
        1.0 if rest > 1.0 - LEAST_PROBABILITY else rest if rest > LEAST_PROBABILITY else 0.0,
        rest_position,
        max(0.0, rest_variance),
        position,
        velocity,
        max(0.0, position_variance),
        covariance,
        max(0.0, velocity_variance),
    )


@compiled
def _log_density(innovation: float, variance: float) -> float:
    """Return the logarithm of a normal density, with heavier tails far out."""
    square = innovation * innovation / variance
    if square > OUTLIER:
        square = OUTLIER * (1.0 + math.log(square / OUTLIER))
    return -0.5 * (math.log(variance) + square + LOG_2_PI)


@compiled
def update_position(belief: Belief, measured: float, noise: float) -> tuple[Belief, float]:
    """Return the belief once a position (m) was measured, and the measurement's log-likelihood.

    Args:
        belief: before.
        measured: m.
        noise: standard deviation of the measurement, m.
    """
    uncertain = noise * noise
    rest_variance = belief.rest_variance + uncertain
    variance = belief.position_variance + uncertain
    rest_innovation = measured - belief.rest_position
    innovation = measured - belief.position
    rest, log_likelihood = _weigh(belief.rest, rest_innovation, rest_variance, innovation, variance)
    of_rest = belief.rest_variance / rest_variance
    of_position = belief.position_variance / variance
    of_velocity = belief.covariance / variance
    return (
        Belief(
            rest,
            belief.rest_position + of_rest * rest_innovation,
            of_rest * uncertain,
            belief.position + of_position * innovation,
            belief.velocity + of_velocity * innovation,
            of_position * uncertain,
            belief.covariance * uncertain / variance,
            max(0.0, belief.velocity_variance - of_velocity * belief.covariance),
        ),
        log_likelihood,
    )


@compiled
def update_velocity(belief: Belief, measured: float, noise: float) -> tuple[Belief, float]:
    """Return the belief once a velocity (m/s) was measured, and its log-likelihood.

    Args:
        belief: before.
        measured: m/s.
        noise: standard deviation of the measurement, m/s.
    """
    uncertain = noise * noise
    variance = belief.velocity_variance + uncertain
    innovation = measured - belief.velocity
    rest, log_likelihood = _weigh(belief.rest, measured, uncertain, innovation, variance)
    of_position = belief.covariance / variance
    of_velocity = belief.velocity_variance / variance
    return (
        Belief(
            rest,
            belief.rest_position,
            belief.rest_variance,
            belief.position + of_position * innovation,
            belief.velocity + of_velocity * innovation,
            max(0.0, belief.position_variance - of_position * belief.covariance),
            belief.covariance * uncertain / variance,
            of_velocity * uncertain,
        ),
        log_likelihood,
    )


@compiled
def _weigh(
    rest: float, rest_innovation: float, rest_variance: float, innovation: float, variance: float
) -> tuple[float, float]:
    """Return the probability of rest by how likely each mode made a measurement; and of it."""
    if rest == 0.0:
        return rest, _log_density(innovation, variance)
    if rest == 1.0:
        return rest, _log_density(rest_innovation, rest_variance)
    at_rest = math.log(rest) + _log_density(rest_innovation, rest_variance)
    sliding = math.log(1.0 - rest) + _log_density(innovation, variance)
    most = max(at_rest, sliding)
    log_likelihood = most + math.log(math.exp(at_rest - most) + math.exp(sliding - most))
    weighed = math.exp(at_rest - log_likelihood)
    if weighed > 1.0 - LEAST_PROBABILITY:
        weighed = 1.0
    elif weighed < LEAST_PROBABILITY:
        weighed = 0.0
    return weighed, log_likelihood


@compiled
def mean_state(belief: Belief) -> tuple[float, float]:
    """Return the mean position (m) and velocity (m/s)."""
    slides = 1.0 - belief.rest
    position = belief.rest * belief.rest_position + slides * belief.position
    return position, slides * belief.velocity
