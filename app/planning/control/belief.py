"""The plant that is believed: the model with what was learned of it; compiled.

The filter that learns is in kalman.py; how far the model may be off is said in observer.py.
"""

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.control.memory import (
    BACKWARD,
    BIAS,
    COULOMB,
    DAMPING,
    FORWARD,
    GAIN,
    LEAST,
    MOST,
    Memory,
)
from app.planning.control.settings import Settings
from app.planning.plant.system import Plant

MOVING = 2.0
"""Rest velocities, above which a mass has broken away."""
DOUBT = 2.0
"""Standard deviations of the disturbing acceleration, by which a push may have been another."""
HARDER = 1.1
"""By this factor static friction exceeds a push that did not break it."""
FEASIBLE = 0.97
"""Of full control: more static friction is not believed in, or nothing would be tried."""
STRONGEST_DAMPING = 0.95
"""Of the velocity, in a step."""


@compiled
def forget(memory: Memory, model: Plant, settings: Settings, doubt: float) -> None:
    """Believe the model again, and nothing that was learned of it.

    The standard deviations of its parameters are `doubt` times what the settings say.
    """
    mean, covariance, share = memory.mean, memory.covariance, settings.static_share
    covariance[GAIN:] = 0.0
    covariance[:, GAIN:] = 0.0
    mean[GAIN] = mean[COULOMB] = mean[DAMPING] = 1.0
    mean[BIAS] = model.bias
    doubt *= doubt
    covariance[GAIN, GAIN] = doubt * settings.gain_variance
    covariance[COULOMB, COULOMB] = doubt * settings.coulomb_variance
    covariance[DAMPING, DAMPING] = doubt * settings.damping_variance
    covariance[BIAS, BIAS] = doubt * settings.bias_variance
    memory.statics[FORWARD, LEAST] = (1.0 - share) * model.static_forward
    memory.statics[FORWARD, MOST] = (1.0 + share) * model.static_forward
    memory.statics[BACKWARD, LEAST] = (1.0 - share) * model.static_backward
    memory.statics[BACKWARD, MOST] = (1.0 + share) * model.static_backward


@compiled
def believed(model: Plant, memory: Memory, caution: float, rest_velocity: float) -> Plant:
    """Return the model with what has been learned.

    Its static friction is a share `caution` of the way between what it is at least and at most, but
    such that full control overcomes it; its velocity threshold is `rest_velocity`, m/s.
    """
    mean = memory.mean
    gain, bias = mean[GAIN] * model.control_gain, mean[BIAS]
    push = gain * model.highest_control + bias
    pull = -(gain * model.lowest_control + bias)
    forward = model.control_gain * model.highest_control + model.bias > model.static_forward
    backward = -(model.control_gain * model.lowest_control + model.bias) > model.static_backward
    coulomb_forward = mean[COULOMB] * model.coulomb_forward
    coulomb_backward = mean[COULOMB] * model.coulomb_backward
    static_forward = _static(memory.statics[FORWARD], caution, coulomb_forward, push, forward)
    static_backward = _static(memory.statics[BACKWARD], caution, coulomb_backward, pull, backward)
    coulomb_forward = min(static_forward, coulomb_forward)
    coulomb_backward = min(static_backward, coulomb_backward)
    strongest = STRONGEST_DAMPING / model.time_step
    weakens = model.stribeck_velocity > 0.0
    return Plant(
        static_forward,
        static_backward,
        coulomb_forward,
        coulomb_backward,
        min(strongest, mean[DAMPING] * model.damping_forward),
        min(strongest, mean[DAMPING] * model.damping_backward),
        static_forward if weakens else coulomb_forward,
        static_backward if weakens else coulomb_backward,
        model.stribeck_velocity,
        bias,
        gain,
        model.lowest_control,
        model.highest_control,
        model.time_step,
        rest_velocity,
    )


@compiled
def _static(bounds: FloatArray, caution: float, coulomb: float, push: float, moves: bool) -> float:
    """Return what is believed of a static friction, m/s^2: no less than of the Coulomb friction.

    Where full control `moves` the model, it is believed to overcome what was learned, too: a force
    that kept the mass from moving may be gone, and nothing else would tell.
    """
    static: float = max(coulomb, bounds[LEAST] + caution * (bounds[MOST] - bounds[LEAST]))
    if moves and push > 0.0:
        static = min(static, FEASIBLE * push)
    return static


@compiled
def bound_static(
    pushed: float, velocity: float, bounds: FloatArray, model: Plant, settings: Settings
) -> None:
    """Narrow what static friction can be, by a push (m/s^2) that broke a resting mass away or not.

    A noisy sensor does not tell that a mass has not moved at all: then only what is to be tried
    next becomes more.
    """
    doubt = DOUBT * settings.acceleration_noise
    if abs(velocity) > MOVING * settings.rest_velocity:
        bounds[MOST] = max(bounds[LEAST], min(bounds[MOST], pushed + doubt))
    elif abs(velocity) < settings.rest_velocity and pushed > bounds[LEAST]:
        if pushed >= bounds[MOST]:
            bounds[MOST] = HARDER * pushed
        if settings.rest_velocity <= model.velocity_threshold:
            bounds[LEAST] = max(bounds[LEAST], pushed - doubt)
