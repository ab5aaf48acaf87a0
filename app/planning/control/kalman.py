"""A Kalman filter through the stick-slip step: state, and what the model has wrong; compiled.

What it is told is in observer.py. Nothing here chooses a control.
"""

import math

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.control.belief import DOUBT, believed, bound_static, forget
from app.planning.control.memory import (
    ACTING,
    BACKWARD,
    COULOMB,
    DAMPING,
    FORWARD,
    FROZEN,
    GAIN,
    LEAST,
    NUM_ESTIMATED,
    POSITION,
    PUSHED,
    STEPS,
    VELOCITY,
    Memory,
)
from app.planning.control.settings import Settings
from app.planning.plant.friction import BREAKING_AWAY, SLIDING, acceleration, take_step
from app.planning.plant.system import Plant

GATE = 4.0
"""Standard deviations: an innovation beyond them is a push that the model does not know."""
FROZEN_STEPS = 3.0
"""For which nothing is learned after a push: it would be taken for friction (pitfall 4)."""
PATIENCE = 10.0
"""Steps of a push, after which it is taken for an error of the model."""
FORGIVEN = 0.25
"""Steps of a push that each predicted step makes up for: what is wrong shows now and then."""
DOUBTED, MOST_DOUBTED = 2.0, 64.0
"""By this factor the standard deviations of the parameters grow with each further step; at most."""
LEARNING = 3.0
"""Rest velocities, above which a motion tells of the parameters."""
REST_NOISE = 0.25
"""Of the velocity that a step of full control adds: how well a mass is known to rest that might
have been pushed beyond its static friction."""
LEAST_FACTOR, GREATEST_FACTOR = 0.25, 4.0
"""As far as an estimate may go from the model's parameter."""
INITIAL_VELOCITY_STEPS = 10.0
"""Of full control, to the standard deviation of an initial velocity that is not measured."""


@compiled
def observe(
    position: float, velocity: float, memory: Memory, model: Plant, settings: Settings
) -> None:
    """Take a measured `position` (m) and `velocity` (m/s; NaN if not measured) into account.

    Extended Kalman filter (Simon, Optimal State Estimation, Sect. 13.2) over position, velocity,
    and factors of gain, Coulomb friction and damping beside the bias, each step linearised where
    the friction law is. Without an observer the measurement is the state. Either way a mass that
    breaks away, or does not, bounds static friction.
    """
    mean, registers = memory.mean, memory.registers
    if registers[STEPS] == 0.0:
        forget(memory, model, settings, 1.0)
        _begin(position, velocity, memory, model, settings)
        return
    plant = believed(model, memory, 0.5, settings.rest_velocity)
    pushed = acceleration(registers[ACTING], plant)
    bounds = memory.statics[FORWARD if pushed > 0.0 else BACKWARD]
    rested = abs(mean[VELOCITY]) < settings.rest_velocity
    if settings.observes:
        stays = rested and abs(pushed) < bounds[LEAST] - DOUBT * settings.acceleration_noise
        _predict(registers[ACTING], stays, memory, model, plant, settings)
        _correct(position, velocity, memory, model, settings)
    else:
        mean[POSITION], mean[VELOCITY] = position, velocity
    if rested and registers[FROZEN] == 0.0:
        bound_static(abs(pushed), mean[VELOCITY], bounds, model, settings)


@compiled
def _begin(
    position: float, velocity: float, memory: Memory, model: Plant, settings: Settings
) -> None:
    is_known = not math.isnan(velocity)
    lag = settings.position_lag
    memory.mean[VELOCITY] = velocity if is_known else 0.0
    memory.mean[POSITION] = position + lag * memory.mean[VELOCITY]
    if settings.observes:
        unknown = (INITIAL_VELOCITY_STEPS * _full_step(model)) ** 2
        variance = settings.velocity_variance if is_known else unknown
        covariance = memory.covariance
        covariance[POSITION, POSITION] = settings.position_variance + lag * lag * variance
        covariance[POSITION, VELOCITY] = covariance[VELOCITY, POSITION] = lag * variance
        covariance[VELOCITY, VELOCITY] = variance


@compiled
def _full_step(model: Plant) -> float:
    """Return the velocity that full control adds in a step, m/s."""
    half = 0.5 * (model.highest_control - model.lowest_control)
    return model.time_step * model.control_gain * half


@compiled
def _predict(
    control: float, stays: bool, memory: Memory, model: Plant, plant: Plant, settings: Settings
) -> None:
    """Advance mean and covariance over a step with `control`.

    The next velocity's slopes by velocity and parameters are those of the step's kind; none where
    the mass is stuck or stops. What surely `stays` at rest is as well known as what moves.
    """
    mean, covariance, time_step = memory.mean, memory.covariance, plant.time_step
    velocity = mean[VELOCITY]
    step = take_step(velocity, control, plant)
    slopes = (0.0, step.by_velocity, 0.0, 0.0, 0.0, 0.0)
    noise = time_step * settings.acceleration_noise if stays else REST_NOISE * _full_step(model)
    if step.kind in (BREAKING_AWAY, SLIDING):
        forward = step.direction > 0.0
        coulomb = model.coulomb_forward if forward else model.coulomb_backward
        damping = model.damping_forward if forward else model.damping_backward
        damping = damping * velocity if step.kind == SLIDING else 0.0
        slopes = (
            0.0,
            step.by_velocity,
            time_step * model.control_gain * control,
            -time_step * step.direction * coulomb,
            -time_step * damping,
            time_step,
        )
        noise = time_step * settings.acceleration_noise
    # Covariances of the next velocity with all that was estimated before.
    across = covariance[0] * 0.0
    variance = noise * noise
    for j in range(NUM_ESTIMATED):
        for i in range(1, NUM_ESTIMATED):
            across[j] += slopes[i] * covariance[i, j]
    for i in range(1, NUM_ESTIMATED):
        variance += slopes[i] * across[i]
    position_variance = covariance[POSITION, POSITION] + 2.0 * time_step * across[POSITION]
    covariance[POSITION, POSITION] = position_variance + time_step * time_step * variance
    for j in range(2, NUM_ESTIMATED):
        both = covariance[POSITION, j] + time_step * across[j]
        covariance[POSITION, j] = covariance[j, POSITION] = both
        covariance[VELOCITY, j] = covariance[j, VELOCITY] = across[j]
    both = across[POSITION] + time_step * variance
    covariance[POSITION, VELOCITY] = covariance[VELOCITY, POSITION] = both
    covariance[VELOCITY, VELOCITY] = variance
    mean[VELOCITY] = step.next_velocity
    mean[POSITION] += time_step * step.next_velocity


@compiled
def _correct(
    position: float, velocity: float, memory: Memory, model: Plant, settings: Settings
) -> None:
    """Weigh the measurement against the prediction; a push teaches nothing of the model.

    Steps of a push are counted, and predicted ones make up for them slowly: where what was learned
    is wrong, hops one way may be as predicted and those back may not. Beyond what a push lasts it
    is forgotten, and learned anew from the next step on that is within what is thought possible.
    """
    mean, covariance, registers = memory.mean, memory.covariance, memory.registers
    lag = settings.position_lag
    is_known = not math.isnan(velocity)
    off, expected, _ = _innovation(
        POSITION, lag, position, settings.position_variance, mean, covariance
    )
    is_push = off**2 > GATE * GATE * expected
    if is_known:
        off, expected, _ = _innovation(
            VELOCITY, 0.0, velocity, settings.velocity_variance, mean, covariance
        )
        is_push = is_push or off**2 > GATE * GATE * expected
    if is_push:
        registers[FROZEN] = FROZEN_STEPS
        registers[PUSHED] += 1.0
        _let_push(_full_step(model), model.time_step, covariance)
    else:
        registers[FROZEN] = max(0.0, registers[FROZEN] - 1.0)
    if registers[PUSHED] > PATIENCE:
        if is_push:
            # No push lasts so long: what was learned is wrong, or the model worse than was said.
            doubt = min(MOST_DOUBTED, DOUBTED ** (registers[PUSHED] - PATIENCE - 1.0))
            forget(memory, model, settings, doubt)
            registers[FROZEN] = 1.0
        else:
            registers[PUSHED] = 0.0
    elif registers[FROZEN] == 0.0:
        registers[PUSHED] = max(0.0, registers[PUSHED] - FORGIVEN)
    # Where too much friction is believed in, a hop that is seen was not predicted.
    speed = max(abs(mean[VELOCITY]), abs(velocity)) if is_known else abs(mean[VELOCITY])
    learns = registers[FROZEN] == 0.0 and speed > LEARNING * settings.rest_velocity
    # A mass that was thought to break away and did not tells of static friction alone.
    learns = learns and not (is_known and abs(velocity) < settings.rest_velocity)
    _update(POSITION, lag, position, settings.position_variance, learns, mean, covariance)
    if is_known:
        _update(VELOCITY, 0.0, velocity, settings.velocity_variance, learns, mean, covariance)
    for parameter in (GAIN, COULOMB, DAMPING):
        mean[parameter] = min(GREATEST_FACTOR, max(LEAST_FACTOR, mean[parameter]))


@compiled
def _let_push(speed: float, time_step: float, covariance: FloatArray) -> None:
    """Let a force that nothing is known of have changed the velocity by `speed`, m/s, in a step."""
    variance = speed * speed
    covariance[VELOCITY, VELOCITY] += variance
    covariance[POSITION, VELOCITY] += time_step * variance
    covariance[VELOCITY, POSITION] += time_step * variance
    covariance[POSITION, POSITION] += time_step * time_step * variance


@compiled
def _innovation(
    index: int,
    lag: float,
    measured: float,
    variance: float,
    mean: FloatArray,
    covariance: FloatArray,
) -> tuple[float, float, FloatArray]:
    """Return what a number measured `lag` ago is off by, the variance of that, and its covariances.

    These are with all that is estimated, before the measurement.
    """
    row = covariance[index] - lag * covariance[VELOCITY]
    total = row[index] - lag * row[VELOCITY] + variance
    return measured - (mean[index] - lag * mean[VELOCITY]), total, row


@compiled
def _update(
    index: int,
    lag: float,
    measured: float,
    variance: float,
    learns: bool,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Correct by one number measured `lag` ago, in Joseph's form: any gain may be taken."""
    residual, total, row = _innovation(index, lag, measured, variance, mean, covariance)
    gain = row / total
    if not learns:
        for i in range(GAIN, NUM_ESTIMATED):
            gain[i] = 0.0
    for i in range(NUM_ESTIMATED):
        mean[i] += gain[i] * residual
    for i in range(NUM_ESTIMATED):
        for j in range(i + 1):
            covariance[i, j] += gain[i] * total * gain[j] - gain[i] * row[j] - row[i] * gain[j]
            covariance[j, i] = covariance[i, j]
