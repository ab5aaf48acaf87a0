"""The unknowns of a fit: what is searched for, in which coordinates, and the plants that they are.

Static friction is Coulomb friction and an excess, gain and noise are logarithms: every point within
the bounds is a plant. Frictions and bias are those over the gain, in units of control: with another
gain the same controls set the mass off, where otherwise a search along the valley of gain, friction
and damping would have to cross a ridge at every break-away.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from app.planning.arrays import BoolArray, FloatArray
from app.planning.plant.system import LARGEST, SMALLEST, ByDirection, Plant, System

DIRECTIONS = ("forward", "backward")
GAIN, BIAS = "control_gain", "bias"
COULOMB, STATIC, DAMPING = "coulomb_friction", "static_friction", "viscous_damping"
FRICTIONS = (COULOMB, STATIC, DAMPING)
OVER_GAIN = {COULOMB, STATIC, BIAS}
COLUMNS = {COULOMB: "coulomb", STATIC: "static", DAMPING: "damping"}
NOISES = ("acceleration_noise", "position_noise", "velocity_noise")
EXCESS_SHARE = 0.5
"""Of Coulomb friction: what static friction is expected to exceed it by, where a log says nothing;
an exponential prior of that mean, which any log that shows break-aways outweighs."""
LITTLE_DRAG = 0.01
"""Of what controls do to the mass: what viscous damping takes at the speeds of a log. Above that
its prior is one over it, for nothing is known of its size; flat below. A log of slow motion, or one
that random forces disturb, does not tell damping, and plans go faster than the log."""
EXPECTED_BIAS = 0.3
"""Of what controls do to the mass: the standard deviation of a normal prior. A log of one direction
cannot tell a bias from friction."""
LEAST_VELOCITY_NOISE = 1e-7
"""Of the speeds in a log."""
MOST_LOG = 50.0
MOST_DAMPED = 0.95
"""Share of its velocity that damping may take in a step."""


@dataclass(frozen=True, slots=True)
class Scale:
    """How large things are in a log, about."""

    acceleration: float
    """m/s^2: what controls do to the mass."""
    velocity: float
    """m/s, in motion."""
    control: float
    """Units of control."""


@dataclass(frozen=True)  # no slots: what a search asks for at each step is kept
class Space:
    """The unknowns, as a vector x (d,).

    Args:
        known: fields of `System` that are certain; a friction is then known in both directions.
        fixed_bias: m/s^2, where it is neither known nor searched for.
        by_direction: whether frictions may differ by direction.
        base: a plant with all else.
        scale: of the log.
        least_noise: m, of positions.
        with_velocities: whether there are any.
    """

    known: dict[str, Any]
    fixed_bias: float | None
    by_direction: bool
    base: Plant
    scale: Scale
    least_noise: float
    with_velocities: bool

    @cached_property
    def names(self) -> list[str]:
        """The unknowns in the order of x: fields of `System`, with a direction where they have one,
        then the noises."""
        names = [] if GAIN in self.known else [GAIN]
        for field in FRICTIONS:
            if field not in self.known:
                names += self.names_of(field)
        if BIAS not in self.known and self.fixed_bias is None:
            names.append(BIAS)
        return names + list(NOISES[: 2 + self.with_velocities])

    def names_of(self, field: str) -> list[str]:
        """Return the names of a friction, one or one for each direction."""
        return [f"{field}.{way}" for way in DIRECTIONS] if self.by_direction else [field]

    def values(self, x: FloatArray) -> dict[str, FloatArray]:
        """Return all parameters by name, each (N,), of points (N, d); known ones as well."""
        given = dict(zip(self.names, x.T, strict=True))
        logarithms = {GAIN, *NOISES} & given.keys()
        # A search may look anywhere.
        given |= {name: np.exp(np.clip(given[name], -MOST_LOG, MOST_LOG)) for name in logarithms}
        count = len(x)
        gain = given.get(GAIN, np.full(count, self.base.control_gain))
        given |= {name: given[name] * gain for name in given if _field(name) in OVER_GAIN}
        values: dict[str, FloatArray] = {
            GAIN: gain,
            BIAS: given.get(BIAS, np.full(count, self.base.bias)),
        }
        for field in (COULOMB, DAMPING, STATIC):
            for way, name in zip(DIRECTIONS, self._both(field), strict=True):
                if name in given:
                    value = given[name]
                    if field == STATIC:
                        value = value + values[f"{COULOMB}.{way}"]
                else:
                    value = np.full(count, getattr(self.base, f"{COLUMNS[field]}_{way}"))
                values[f"{field}.{way}"] = value
        for name in NOISES:
            values[name] = given.get(name, np.ones(count))
        return values

    def _both(self, field: str) -> list[str]:
        """Return the name of the unknown for each direction."""
        return [f"{field}.{way}" if self.by_direction else field for way in DIRECTIONS]

    def point(self, values: dict[str, float]) -> FloatArray:
        """Return x (d,) of parameters by the names of `values`; of both directions the first."""
        gain = values[GAIN] if GAIN in self.names else self.base.control_gain
        x = []
        for name in self.names:
            field, _, way = name.partition(".")
            way = way or DIRECTIONS[0]
            if name in (GAIN, *NOISES):
                x.append(np.log(values[name]))
            elif field == STATIC:
                x.append((values[f"{STATIC}.{way}"] - values[f"{COULOMB}.{way}"]) / gain)
            elif field == COULOMB:
                x.append(values[f"{COULOMB}.{way}"] / gain)
            elif field == DAMPING:
                x.append(values[f"{DAMPING}.{way}"])
            else:
                x.append(values[BIAS] / gain)
        return np.array(x)

    @cached_property
    def widths(self) -> FloatArray:
        """How far the unknowns may be from a first guess, (d,): standard deviations."""
        scale = self.scale
        control = scale.control
        if GAIN in self.known:
            control = scale.acceleration / self.base.control_gain
        of = {
            GAIN: 0.2,
            COULOMB: 0.15 * control,
            STATIC: 0.1 * control,
            DAMPING: 0.15 * scale.acceleration / scale.velocity,
            BIAS: 0.1 * control,
            NOISES[0]: 1.0,
            NOISES[1]: 0.5,
            NOISES[2]: 0.5,
        }
        return np.array([of[_field(name)] for name in self.names])

    def plants(self, values: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return plants (N, parameters), noises (N, 3), and which of both can be, of parameters.

        What cannot be is replaced by what can, for the kernel.
        """
        table = np.empty((len(values[GAIN]), len(self.base)))
        table[:] = self.base
        columns = dict(zip(Plant._fields, table.T, strict=True))
        columns[GAIN][:] = values[GAIN]
        columns[BIAS][:] = values[BIAS]
        for field in FRICTIONS:
            for way in DIRECTIONS:
                columns[f"{COLUMNS[field]}_{way}"][:] = values[f"{field}.{way}"]
        for way in DIRECTIONS:
            of_first_step = "static" if self.base.stribeck_velocity > 0.0 else "coulomb"
            columns[f"breakaway_{way}"][:] = columns[f"{of_first_step}_{way}"]
        noises = np.column_stack([values[name] for name in NOISES])
        possible = self._possible(columns, values)
        table[~possible] = self.base
        noises[~possible] = 1.0
        return table, noises, possible

    def _possible(self, columns: dict[str, FloatArray], values: dict[str, FloatArray]) -> BoolArray:
        scale = self.scale
        most = min(LARGEST, 20.0 * scale.acceleration)
        # Each is compared with a bound at least: what is no number cannot be.
        possible: BoolArray = (values[GAIN] >= SMALLEST) & (values[GAIN] <= LARGEST)
        possible &= np.abs(values[BIAS]) <= most
        for way in DIRECTIONS:
            coulomb, static = columns[f"coulomb_{way}"], columns[f"static_{way}"]
            damping = columns[f"damping_{way}"]
            possible &= (coulomb >= 0.0) & (static >= coulomb) & (static <= most)
            possible &= (damping >= 0.0) & (damping * self.base.time_step <= MOST_DAMPED)
        possible &= values[NOISES[0]] >= 1e-6 * scale.acceleration
        possible &= values[NOISES[0]] <= most
        possible &= values[NOISES[1]] >= self.least_noise
        if self.with_velocities:
            possible &= values[NOISES[2]] >= LEAST_VELOCITY_NOISE * self.scale.velocity
        return possible

    def log_prior(self, values: dict[str, FloatArray]) -> FloatArray:
        """Return the logarithm of the prior density of parameters, (N,), up to a constant.

        It is one of frictions and bias themselves: over the gain they are as much denser.
        """
        # Flat in the random acceleration: its logarithm would go down for ever where there is none.
        prior = np.log(np.maximum(values[NOISES[0]], 1e-300))
        num_over_gain = sum(_field(name) in OVER_GAIN for name in self.names)
        prior += num_over_gain * np.log(values[GAIN])
        if BIAS not in self.known and self.fixed_bias is None:
            prior -= 0.5 * (values[BIAS] / (EXPECTED_BIAS * self.scale.acceleration)) ** 2
        ways = DIRECTIONS[: 1 + self.by_direction]
        if DAMPING not in self.known:
            for way in ways:
                damping = np.maximum(values[f"{DAMPING}.{way}"], 0.0)
                prior -= np.log(
                    damping * self.scale.velocity / self.scale.acceleration + LITTLE_DRAG
                )
        if STATIC in self.known:
            return prior
        for way in ways:
            coulomb = np.maximum(values[f"{COULOMB}.{way}"], 0.0)
            expected = EXCESS_SHARE * (coulomb + 0.02 * self.scale.acceleration)
            prior -= (values[f"{STATIC}.{way}"] - coulomb) / expected + np.log(expected)
        return prior

    def system(self, x: FloatArray, limits: Any) -> System:
        """Return the system of one point (d,)."""
        values = {name: float(value[0]) for name, value in self.values(x[np.newaxis]).items()}

        def friction(field: str) -> float | ByDirection:
            forward, backward = (values[f"{field}.{way}"] for way in DIRECTIONS)
            return forward if forward == backward else ByDirection(forward, backward)

        return System(
            static_friction=friction(STATIC),
            coulomb_friction=friction(COULOMB),
            viscous_damping=friction(DAMPING),
            stribeck_velocity=self.base.stribeck_velocity or None,
            bias=values[BIAS],
            control_gain=values[GAIN],
            control_limit=limits,
            time_step=self.base.time_step,
            velocity_threshold=self.base.velocity_threshold,
        )


def _field(name: str) -> str:
    """Return the field of `System` that an unknown is of; its own name, if it is a noise."""
    return name.partition(".")[0]
