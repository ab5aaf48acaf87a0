"""The fit of some unknowns to one log: a start, the likeliest point, and a sample around it.

What to fit, a delay and whether frictions differ by direction, is decided in identify.py.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.identification.evolution import Found, maximise
from app.planning.identification.likelihood import Record, log_likelihoods
from app.planning.identification.log import Log
from app.planning.identification.parameters import (
    BIAS,
    COULOMB,
    DAMPING,
    DIRECTIONS,
    GAIN,
    NOISES,
    STATIC,
    Space,
)
from app.planning.identification.posterior import Sample, draw_sample
from app.planning.identification.prediction import Trace, trace
from app.planning.identification.starts import Guess
from app.planning.plant.system import Plant
from app.planning.stop import Stop
from app.planning.uncertainty.ensemble import Scenarios

NUM_BLOCKS = 25
"""Of a log, whose likelihoods' slopes tell whether a posterior is too narrow."""
FIRST_EXCESSES = (0.1, 0.4)
"""Of static over Coulomb friction, that a start may have."""
FIRST_NOISE = 0.3
"""Of the random acceleration over what controls do, that starts have: they are rough."""
EXCESS_FACTORS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
"""Of static over Coulomb friction, that a search may have missed."""
LEAST_EXCESS = 0.3
"""Of its width: what stands for an excess that is next to nothing, of which all factors are."""
NOISE_FACTORS = (1.0, 0.2, 0.04)
"""Of the random acceleration, likewise."""
NEARBY = 0.1
"""Of the unknowns' widths: where to look once the likeliest of a simpler plant, or of one across a
ridge, is known."""
MOST_RIDGES = 4
POPULATION = 4
"""For each unknown: fewer stop in valleys that are not the deepest."""
GENERATIONS = 200
CHAIN_GENERATIONS = 16
"""For each unknown: fewer leave the chains where they began, and intervals too narrow."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A space of unknowns and the log that they are sought for."""

    space: Space
    record: Record
    stop: Stop

    @classmethod
    def of(cls, space: Space, log: Log, stride: int, stop: Stop) -> "Fit":
        """Return the fit of a log whose controls act at once."""
        return cls(space, log.record(stride), stop)

    def log_density(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the posterior's logarithm at points (N, d), (N,), and its blocks' part, (N, B).

        Raises:
            Stopped: it is not wanted any more.
        """
        self.stop.check()
        parameters = self.space.values(x)
        plants, noises, possible = self.space.plants(parameters)
        # What cannot be is not worked out.
        blocks = np.zeros((len(x), NUM_BLOCKS))
        values = np.full(len(x), -np.inf)
        blocks[possible] = log_likelihoods(
            _scenarios(plants[possible]), noises[possible], self.record, NUM_BLOCKS
        )[:, 0]
        prior = self.space.log_prior({name: each[possible] for name, each in parameters.items()})
        values[possible] = blocks[possible].sum(axis=1) + prior
        return values, blocks

    def value(self, x: FloatArray) -> FloatArray:
        """Return the posterior's logarithm at points (N, d): (N,)."""
        return self.log_density(x)[0]

    def starts(self, found: list[Guess], log: Log) -> FloatArray:
        """Return points (N, d) to start from, of guesses by least squares."""
        scale = self.space.scale
        position_noise, velocity_noise = log.position_noise, log.velocity_noise
        points = []
        for guess in found:
            coulomb = max(guess.coulomb_friction, 0.02 * scale.acceleration)
            damping = min(max(guess.viscous_damping, 0.0), 0.5 / self.space.base.time_step)
            bias = float(np.clip(guess.bias, -coulomb, coulomb))
            for excess in FIRST_EXCESSES:
                values = {
                    GAIN: guess.control_gain,
                    BIAS: bias,
                    NOISES[0]: FIRST_NOISE * scale.acceleration,
                    NOISES[1]: 1.01 * position_noise,
                    NOISES[2]: 1.01 * (velocity_noise or 1.0),
                }
                # Where it may not be a bias, it is a friction that differs by direction.
                shift = 0.0 if self.space.fixed_bias is None else bias
                for way, sign in zip(DIRECTIONS, (-1.0, 1.0), strict=True):
                    values[f"{COULOMB}.{way}"] = coulomb + sign * shift
                    values[f"{STATIC}.{way}"] = (1.0 + excess) * coulomb + sign * shift
                    values[f"{DAMPING}.{way}"] = damping
                points.append(self.space.point(values))
        return np.array(points)

    def climb(
        self,
        start: FloatArray,
        covariance: FloatArray,
        rng: np.random.Generator,
        generations: int = GENERATIONS,
    ) -> Found:
        """Search for the likeliest point from a start (d,), with a covariance (d, d) around it."""
        return maximise(
            self.value,
            start,
            covariance,
            rng,
            generations=generations,
            population=POPULATION * start.size,
            spread=start.size,
        )

    def settle(self, found: Found, rng: np.random.Generator) -> Found:
        """Go on from where a search ended, as long as the likelihood is greater across a ridge.

        Much random acceleration explains late break-aways by chance, where another static friction
        and none explain them outright; a search does not pass from the one to the other.
        """
        for _ in range(MOST_RIDGES):
            across = self.across_ridges(found.best)
            if across is found.best:
                break
            found = self.climb(across, self.around(NEARBY), rng)
        return found

    def across_ridges(self, x: FloatArray) -> FloatArray:
        """Return the likeliest of x (d,) and of points that differ from it in static friction and
        in what is random."""
        names = self.space.names
        statics = [k for k, name in enumerate(names) if name.startswith(STATIC)]
        excesses = np.maximum(x[statics], LEAST_EXCESS * self.space.widths[statics])
        points = [x]
        for *factors, noise in product(*[EXCESS_FACTORS] * len(statics), NOISE_FACTORS):
            point = x.copy()
            point[statics] = excesses * factors
            point[names.index(NOISES[0])] += np.log(noise)
            points.append(point)
        return points[int(np.argmax(self.value(np.array(points))))]

    def around(self, share: float) -> FloatArray:
        """Return the covariance (d, d) of where a search begins, in shares of the widths."""
        return np.diag((share * self.space.widths) ** 2)

    def sample(self, found: Found, rng: np.random.Generator) -> Sample:
        """Draw a sample of the posterior around where a search ended."""
        return draw_sample(
            self.log_density,
            found.best,
            found.covariance,
            rng,
            generations=CHAIN_GENERATIONS * found.best.size,
        )

    def plant(self, x: FloatArray) -> Plant:
        """Return the plant of one point (d,)."""
        return Plant(*self._plants(x)[0].tolist())

    def trace(self, x: FloatArray) -> Trace:
        """Return what the filter makes of the log on one plant, (d,), step by step."""
        return trace(*self._plants(x), self.record)

    def noises(self, x: FloatArray) -> FloatArray:
        """Return those (3,) of one point (d,), as `log_likelihoods` takes them."""
        return self._plants(x)[1]

    def _plants(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        plants, noises, _ = self.space.plants(self.space.values(x[np.newaxis]))
        return plants[0], noises[0]


def _scenarios(plants: FloatArray) -> Scenarios:
    return Scenarios(np.ascontiguousarray(plants), np.zeros((len(plants), 2)), 0.0, 0.0)
