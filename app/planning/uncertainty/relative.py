"""Parameters that are known to within a share of their value, and plants drawn within it."""

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from annotated_types import Ge, Le

from app.planning.arrays import FloatArray
from app.planning.options import Options
from app.planning.plant.system import Plant, System
from app.planning.problem import Problem

Share: TypeAlias = Annotated[float, Ge(0), Le(0.9)]
SLICE = 8
"""A few plants stand for all of them: every so many are spread over the whole range as well."""
NUM_CORNERS = 8
SIGNS = (1, 2, 4, 3, 5, 6)
"""For each parameter, the bits of a corner's number whose parity says on which end it is: an
orthogonal array, in which any two parameters meet in all four ways."""
COLUMNS = {
    "static_friction": ("static_forward", "static_backward"),
    "coulomb_friction": ("coulomb_forward", "coulomb_backward"),
    "viscous_damping": ("damping_forward", "damping_backward"),
    "stribeck_velocity": ("stribeck_velocity",),
    "bias": ("bias",),
    "control_gain": ("control_gain",),
}
"""What of a `Plant` each parameter is; friction is off by the same share in both directions."""


class Implausible(ValueError):
    """A parameter could be so far off that there is no such plant."""

    def __init__(self, parameter: str, message: str) -> None:
        super().__init__(message)
        self.parameter = parameter


@dataclass(frozen=True, slots=True)
class Relative(Options):
    """By what share of its value each parameter may be off, either way: uniform, independent."""

    static_friction: Share = 0.0
    """Raised to Coulomb friction where it would fall below it."""
    coulomb_friction: Share = 0.0
    viscous_damping: Share = 0.0
    stribeck_velocity: Share = 0.0
    bias: Share = 0.0
    control_gain: Share = 0.0

    def draw(self, system: System, num_plants: int, rng: np.random.Generator) -> FloatArray:
        """Draw plants around `system`: (S, parameters), the fields of `Plant` in their order.

        A sliced Latin hypercube: each parameter's values are spread evenly over its range, and so
        are those of every `S // SLICE`-th plant.

        Raises:
            Implausible: the damping would be too strong for the time step.
        """
        return self._plants(system, _spread(len(COLUMNS), num_plants, rng))

    def corners(self, system: System) -> FloatArray:
        """Return plants around `system` whose parameters are all as far off as may be: (8, ...).

        Among them any two parameters are off in all four ways. Plants that are drawn seldom come
        near, and a plan that is made for these alone may get stuck there.

        Raises:
            Implausible: the damping would be too strong for the time step.
        """
        numbers = np.arange(NUM_CORNERS)
        ends = [1.0 - 2.0 * (np.bitwise_count(numbers & bits) % 2) for bits in SIGNS]
        return self._plants(system, np.array(ends))

    def _plants(self, system: System, places: FloatArray) -> FloatArray:
        """Return the plants (S, ...) at `places` (parameters, S), in [-1, 1], of their ranges."""
        plant = system.plant
        damping = max(plant.damping_forward, plant.damping_backward)
        if damping * (1.0 + self.viscous_damping) * plant.time_step >= 1.0:
            raise Implausible(
                "viscous_damping", "viscous_damping * time_step must stay below 1 on every plant"
            )
        table = np.tile(plant, (places.shape[1], 1)).T
        columns = dict(zip(Plant._fields, table, strict=True))
        for (parameter, names), place in zip(COLUMNS.items(), places, strict=True):
            for name in names:
                columns[name] *= 1.0 + getattr(self, parameter) * place
        for direction in ("forward", "backward"):
            static, coulomb = columns[f"static_{direction}"], columns[f"coulomb_{direction}"]
            np.maximum(static, coulomb, out=static)
            weakens = plant.stribeck_velocity > 0.0
            columns[f"breakaway_{direction}"] = static if weakens else coulomb
        return np.column_stack(list(columns.values()))

    def least_rms_error(self, problem: Problem) -> float | None:
        """Return the least r.m.s. error (m) of any control sequence, to first order.

        From rest to rest, forces that are all a share greater move the mass that much farther: the
        sensitivities of the displacement D to the logarithms of Coulomb friction, gain and bias
        (static friction decides only whether there is motion) add up to D, whatever the controls.
        With standard deviations s_i of those logarithms the least of sum (s_i D_i)^2, where the
        D_i add up to D, is D^2 / sum 1/s_i^2: 0 where one of them is certain.

        None where that does not hold: start or target in motion, or Stribeck's effect.
        """
        plant = problem.system.plant
        if problem.initial_state[1] or problem.target_state[1] or plant.stribeck_velocity:
            return None
        shares = [self.control_gain]
        if plant.coulomb_forward or plant.coulomb_backward:
            shares.append(self.coulomb_friction)
        if plant.bias:
            shares.append(self.bias)
        if not all(shares):
            return 0.0
        displacement = abs(float(problem.target_state[0] - problem.initial_state[0]))
        # The standard deviation of a uniform distribution is its half width by the root of 3.
        return displacement / math.sqrt(sum(3.0 / share**2 for share in shares))


def _spread(num_rows: int, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw rows of numbers (num_rows, count) spread evenly over [-1, 1), each slice's as well."""
    slices = math.ceil(count / SLICE)
    shape = num_rows, slices, SLICE
    bins = np.argsort(rng.random(shape), axis=2)
    # Within each of the wide bins, every slice has a narrow one of its own.
    narrow = np.argsort(rng.random(shape), axis=1)
    numbers = (bins * slices + np.take_along_axis(narrow, bins, axis=2) + rng.random(shape)) / (
        slices * SLICE
    )
    # The first of each slice, then the second of each: the slices lie in steps.
    return 2.0 * numbers.transpose(0, 2, 1).reshape(num_rows, -1)[:, :count] - 1.0
