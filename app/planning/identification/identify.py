"""From a log to a plant: the one road, top to bottom.

Guess by least squares, find the delay, climb to the likeliest plant, see whether friction differs
by direction, sample what else it may be, judge. Each step is in a file of its own.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product, starmap
from typing import Any, NamedTuple

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.identification.directions import by_direction
from app.planning.identification.evolution import Found
from app.planning.identification.fitting import Fit
from app.planning.identification.log import Log
from app.planning.identification.log_checks import LEAST_STEPS, UnusableLog
from app.planning.identification.parameters import BIAS, COULOMB, Space
from app.planning.identification.starts import guesses, scale_of
from app.planning.identification.verdict import Identification, judge
from app.planning.plant.system import SMALLEST, System
from app.planning.stop import NEVER, Stop

MOST_DELAY = 8
"""Steps that are tried."""
LAGS = (0.0, 0.5)
"""Of measured positions, in steps."""
TRIED = 5
"""Delays and lags that are climbed for a little."""
LEFT = 3
MOST_MEASUREMENTS = 2500
"""Of a longer log not every sample is taken as a measurement; every control acts all the same."""
CLOSE = 5.0
"""Log-likelihoods that are no farther apart hardly tell two delays apart."""
HEATS = (6, 100.0), (12, 60.0), (24, 40.0), (100, CLOSE)
"""Of those that are left: generations of a search, and what log-likelihood the next one has to
be in the lead by to be alone in it."""
LEAST_MEASUREMENTS = 250
APART_SECONDS = 0.08
"""Between measurements, where their noise does not matter."""
UNEXPLAINED = 0.05
"""Of the accelerations in a log: what a plant is not expected to explain."""
BROAD = 0.2
"""Of the unknowns' widths: where a search begins to look."""
LEAST_THRESHOLD = 0.01
"""Of the speeds in a log: no threshold of rest is above that."""
EVALUATIONS = 15000
"""Likelihoods of a whole log that an answer takes at most, about."""


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of a log."""

    known: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `System` that are certain."""
    by_direction: bool | None = None
    """Whether frictions differ by direction; None to let the log say."""
    delay_steps: int | None = None
    """Of the actuator; None to let the log say."""
    position_lag: float | None = None
    """s: measured positions are those of so long ago; None to let the log say whether 0 or half a
    time step. A control that is held from sample to sample moves a mass in a step by the mean of
    the velocities before and after, the plant by that after: half a step of velocity more."""
    num_systems: int = 32
    """Of the ensemble."""

    def check(self, log: Log) -> None:
        """Check that it can be asked of a log.

        Raises:
            UnusableLog: the log is too short for such a delay, or what is known contradicts itself.
        """
        if self.delay_steps and log.num_steps - self.delay_steps < LEAST_STEPS:
            raise UnusableLog(
                "delay_steps", f"of {log.num_steps} steps, too few are left after such a delay"
            )
        if self.position_lag is not None and not 0.0 <= self.position_lag <= log.time_step:
            raise UnusableLog(
                "position_lag",
                f"{self.position_lag:g} s; from 0 to a time step, {log.time_step:g} s",
            )
        _space(log, self.known)


def identify(
    log: Log, question: Question, rng: np.random.Generator, stop: Stop = NEVER
) -> Identification:
    """Return what a log says of the machine that it is of.

    Args:
        log: checked.
        question: what is known, and what is asked.
        rng: decides every random draw.
        stop: ends it early.

    Raises:
        UnusableLog: nothing follows from it.
        Stopped: it is not wanted any more.
    """
    stride = _stride(log)
    (delay, lag), begun, rival = _timing(log, question, stride, rng, stop)
    acting = replace(log.delayed(delay), position_lag=lag)
    fit = Fit.of(_space(acting, question.known), acting, stride, stop)
    likeliest = fit.settle(fit.climb(begun.best, begun.covariance, rng), rng)
    if question.by_direction is not False:
        is_asked_for = question.by_direction is True
        fit, likeliest = by_direction(fit, likeliest, rng, is_asked_for=is_asked_for)
    sample = fit.sample(likeliest, rng)
    identified = judge(fit, acting, likeliest, sample, question.num_systems, rng)
    warnings = list(identified.warnings)
    if rival is not None:
        warnings.append(
            f"a delay of {rival:g} steps explains the log nearly as well as one of "
            f"{delay + lag / log.time_step:g}: the gain and the frictions are those of the delay "
            "that is given"
        )
    bias = next((each for each in identified.parameters if each.name == BIAS), None)
    if bias and bias.identifiable and not bias.interval[0] <= 0.0 <= bias.interval[1]:
        warnings.append(
            "a bias moves a mass as frictions do that differ by it in both directions; "
            "direction_dependent takes it for that"
        )
    if "control_limit" not in question.known:
        warnings.append(
            "control_limit is the largest control in the log; say the machine's own as known"
        )
    return replace(identified, delay_steps=delay, position_lag=lag, warnings=tuple(warnings))


def _stride(log: Log) -> int:
    """Return of how many samples one is a measurement.

    Where positions are so exact that a plant's own errors are all there is to see, measurements in
    quick succession tell of those alone: of forces that come and go, not of what is there to stay.
    """
    stride = max(1, log.num_steps // MOST_MEASUREMENTS)
    unexplained = UNEXPLAINED * scale_of(log).acceleration * (stride * log.time_step) ** 2
    if log.position_noise < unexplained:
        stride = max(
            stride, min(round(APART_SECONDS / log.time_step), log.num_steps // LEAST_MEASUREMENTS)
        )
    return stride


class _Timing(NamedTuple):
    """When what is measured answers to what was done."""

    delay: int
    """Of the controls, steps."""
    lag: float
    """Of the positions, s."""


class _Begun(NamedTuple):
    """A timing that was tried."""

    timing: _Timing
    fit: Fit
    start: FloatArray
    """(d,)."""
    value: float
    """Of the start."""

    @property
    def found(self) -> Found:
        """Where its search begins, and how broadly it looks around."""
        start = self.fit.across_ridges(self.start)
        return Found(start, self.value, start, self.fit.around(BROAD))


def _timing(
    log: Log, question: Question, stride: int, rng: np.random.Generator, stop: Stop
) -> tuple[_Timing, Found, float | None]:
    """Return the likeliest timing, how far the search for its plant got, and a delay as likely.

    Raises:
        UnusableLog: what is known contradicts itself, or the log.
    """
    step = log.time_step
    most = min(MOST_DELAY, log.num_steps // 10)
    delays: Iterable[int] = range(most + 1)
    if question.delay_steps is not None:
        most = question.delay_steps
        delays = [most]
    lags = [share * step for share in LAGS]
    if question.position_lag is not None:
        lags = [question.position_lag]
    begun = []
    for timing in starmap(_Timing, product(delays, lags)):
        timed = replace(log.delayed(timing.delay, most), position_lag=timing.lag)
        space = _space(timed, question.known)
        fit = Fit.of(space, timed, stride, stop)
        starts = fit.starts(guesses(timed, space.scale), timed)
        values = fit.value(starts)
        best = int(np.argmax(values))
        if np.isfinite(values[best]):
            begun.append(_Begun(timing, fit, starts[best], float(values[best])))
    if not begun:
        raise UnusableLog("known", "no machine that is known to be so moves as in this log")
    begun.sort(key=lambda each: -each.value)
    racing = [(each.found, each) for each in begun[:TRIED]]
    for generations, lead in HEATS:
        racing = [
            (each.fit.climb(found.best, found.covariance, rng, generations), each)
            for found, each in racing
        ]
        racing.sort(key=lambda one: -one[0].value)
        leading = racing[0][0].value
        racing = [one for one in racing[:LEFT] if one[0].value > leading - lead]
        if len(racing) == 1:
            break
    (found, first), *others = racing
    rivals = [each.timing.delay + each.timing.lag / step for _, each in others]
    return first.timing, found, rivals[0] if rivals else None


def _space(log: Log, known: Mapping[str, Any]) -> Space:
    """Return the unknowns of a log, with frictions that are the same both ways.

    Raises:
        UnusableLog: what is known contradicts itself.
    """
    scale = scale_of(log)
    rest = {
        COULOMB: 0.0,
        "static_friction": known.get(COULOMB, 0.0),
        "viscous_damping": 0.0,
        "control_limit": scale.control,
        "velocity_threshold": min(1e-3, max(SMALLEST, LEAST_THRESHOLD * scale.velocity)),
    }
    try:
        base = System(**{**rest, **known, "time_step": log.time_step}).plant
    except ValueError as error:
        raise UnusableLog("known", str(error)) from None
    return Space(
        known=dict(known),
        fixed_bias=None,
        by_direction=False,
        base=base,
        scale=scale,
        least_noise=log.least_noise,
        with_velocities=log.velocities is not None,
    )
