"""In words: why a parameter cannot be told from a log, and what to record so that it can."""

from app.planning.identification.estimate import Parameter
from app.planning.identification.log import Log
from app.planning.identification.motion import Motion
from app.planning.identification.parameters import (
    BIAS,
    COULOMB,
    DAMPING,
    GAIN,
    STATIC,
    Scale,
)
from app.planning.identification.starts import guesses, scale_of

UNCERTAIN = 0.25
"""Half of an interval over the value: a gain or friction beyond that is not told."""
NEGLIGIBLE = 0.05
"""Of what controls do to the mass: an acceleration that is known to within that is told."""
SHIFTS = range(0, 9, 2)
"""Steps by which controls are moved back against positions, as if there were less delay."""
ALIKE = 2.0
"""Fast over slow: speeds nearer to each other do not tell Coulomb friction from damping."""


def is_reversed(log: Log) -> bool:
    """Return whether in a log a positive control pushes backward, by least squares on its windows.

    Only guesses of a positive gain are made, so there are more of them with the true sign. With the
    wrong one the delay that explains most is another: some are tried back.
    """
    scale, as_it_is, turned = scale_of(log), 0, 0
    for shift in SHIFTS:
        samples = len(log.positions) - shift
        controls, positions = log.controls[shift:], log.positions[:samples]
        as_it_is += len(guesses(Log(log.time_step, controls, positions), scale))
        turned += len(guesses(Log(log.time_step, -controls, positions), scale))
    return turned > as_it_is


def why_not_told(
    name: str,
    value: float,
    half_width: float,
    scale: Scale,
    motion: Motion,
    condition_number: float,
) -> str | None:
    """Return why a parameter is not told, None if it is.

    Args:
        name: a field of `System`, perhaps with a direction.
        value: the estimate.
        half_width: half of its interval.
        scale: of the log.
        motion: what there was to see.
        condition_number: of the estimates' correlations.
    """
    field, _, way = name.partition(".")
    reason = _why_not_seen(field, way, motion)
    if reason is not None:
        return reason
    # What the uncertainty makes of an acceleration, and what counts as none.
    as_acceleration = half_width * {
        GAIN: scale.acceleration / max(value, 1e-300),
        DAMPING: scale.velocity,
    }.get(field, 1.0)
    is_negligible = as_acceleration <= NEGLIGIBLE * scale.acceleration
    is_certain = half_width <= UNCERTAIN * abs(value)
    if is_certain or (is_negligible and field != GAIN):
        return None
    spread = f"the log leaves it open by {half_width:.2g} either way"
    if field in (COULOMB, DAMPING) and motion.fast < ALIKE * motion.slow:
        return (
            f"{spread}: eight in ten speeds lie between {motion.slow:.2g} and {motion.fast:.2g} "
            "m/s, where Coulomb friction and damping do the same (condition number "
            f"{condition_number:.0f})"
        )
    if field in (COULOMB, BIAS) and not all(motion.moved):
        return f"{spread}: in one direction a bias cannot be told from friction"
    return f"{spread} (condition number {condition_number:.0f})"


def _why_not_seen(field: str, way: str, motion: Motion) -> str | None:
    """Return why there was nothing to tell a parameter from, whatever the fit says of it."""
    if motion.moving_steps < motion.FEW_STEPS:
        return f"the machine moves in {motion.moving_steps} steps only"
    if way and not motion.moved[0 if way == "forward" else 1]:
        return f"the machine does not move {way} in this log"
    return _why_no_static(way, motion) if field == STATIC else None


def _why_no_static(way: str, motion: Motion) -> str | None:
    forward, backward = motion.set_off
    times = {"forward": forward, "backward": backward}.get(way, forward + backward)
    if times:
        return None
    where = f" {way}" if way else ""
    if motion.longest_rest < 1:
        return "the machine never rests in this log"
    return (
        f"the machine never breaks away{where} from a rest that lasts in this log; the longest "
        f"lasts {motion.longest_rest} steps"
    )


def advise(parameters: tuple[Parameter, ...], motion: Motion) -> tuple[str, ...]:
    """Return what to record so that more can be told."""
    open_fields = {
        parameter.name.partition(".")[0] for parameter in parameters if not parameter.identifiable
    }
    advice = []
    if motion.moving_steps < motion.FEW_STEPS:
        advice.append("record more motion: a few seconds in each direction")
    if STATIC in open_fields:
        advice.append(
            "let the machine come to rest, then raise the control slowly until it breaks away, "
            "several times in each direction"
        )
    if open_fields & {COULOMB, DAMPING}:
        advice.append("dwell at three speeds that are far apart, in each direction")
    if not all(motion.moved):
        advice.append("move in both directions")
    if GAIN in open_fields:
        advice.append("change the control in large steps while the machine moves")
    if advice:
        advice.append("`breakaway identify --excitation system.json` writes controls that do this")
    return tuple(advice)
