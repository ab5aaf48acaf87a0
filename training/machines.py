"""Random machines and tasks: what a model of every machine is trained on."""

from typing import Annotated, Any

import numpy as np
from pydantic import Field

from app.planning.arrays import FloatArray
from app.planning.plant.coverage import Coverage
from app.planning.plant.natural_units import scales
from app.planning.plant.probes import PROBES
from app.planning.plant.spread import Spread
from app.planning.plant.system import Plant
from training.section import Bounds, Section, Share
from training.tasks import Tasks

CONDITION = (
    "displacement_over_reach",
    "initial_velocity_over_speed",
    "target_velocity_over_speed",
    "static_forward_over_limit",
    "static_backward_over_limit",
    "coulomb_forward_over_limit",
    "coulomb_backward_over_limit",
    "coulomb_over_static_forward",
    "coulomb_over_static_backward",
    "root_damping_forward",
    "root_damping_backward",
    "bias_over_limit",
    "log_velocity_threshold",
    "stribeck_share",
    *(f"{probe}_{of}_miss" for probe in PROBES for of in ("position", "velocity")),
)
"""What a model of every machine is told of a task: nothing in it has a unit."""

HALF = 0.5
SPEED_OVER_REACH = 2.0
"""The time unit is such that reach = 2 speed: a distance between states weighs both about alike."""
MOST_DAMPING = 0.9
"""Of the velocity, in a step: a plant loses less than all of it."""
DRIFT = 0.4
"""Of the reach: by so much the whole speed, at the start or the end, shifts what can be reached."""


class RandomMachines(Section):
    """Machines by ranges of their features, and tasks for them.

    Dry friction, bias and limits are in units of what full control makes of the mass; the same
    features with their ranges say which machines a trained model covers.
    """

    static_over_limit: Bounds = (0.02, 0.9)
    """Two of three machines are uniform in it, the others in its logarithm."""
    coulomb_over_static: Bounds = (0.3, 1.0)
    damping_times_horizon: Bounds = (0.0, 40.0)
    """A third of the machines have up to all of it, a third a tenth, a third an eightieth."""
    direction_ratio: Annotated[float, Field(ge=1)] = 2.0
    """Of static friction and of damping, one way over the other, at most; half of the machines are
    the same both ways."""
    bias_over_limit: Annotated[float, Field(ge=0, lt=1)] = 0.2
    """Either way, at most; half of the machines have none."""
    threshold_over_step: Bounds = (0.003, 0.1)
    """The velocity threshold over what full control adds in a step; uniform in the logarithm."""
    stribeck_over_step: Bounds = (0.1, 10.0)
    """The Stribeck velocity over the same; uniform in the logarithm."""
    stribeck_share: Share = 0.1
    """Of the machines that have Stribeck's effect."""
    displacement_over_reach: Annotated[float, Field(gt=0)] = 1.1
    """Targets lie up to so far, either way, from where the velocities carry the mass (`DRIFT`)."""
    near_targets: Share = 0.3
    """Of the targets that lie nearer than that, by a share which is uniform, too."""
    velocity_over_speed: Annotated[float, Field(ge=0)] = 0.75
    """Starts and targets that move do so with up to so much, either way."""
    moving_starts: Share = 0.5
    moving_targets: Share = 0.4

    def sample(self, num_tasks: int, horizon: int, rng: np.random.Generator) -> Tasks:
        """Draw N tasks, each for a machine of its own, which is known exactly."""
        plants = self._sample_plants(num_tasks, horizon, rng)
        reach, speed = scales(Plant(*plants.T), horizon)
        moving = rng.random((2, num_tasks)) < [[self.moving_starts], [self.moving_targets]]
        velocities = rng.uniform(-1, 1, (2, num_tasks)) * moving * self.velocity_over_speed * speed
        nearer = np.where(rng.random(num_tasks) < self.near_targets, rng.random(num_tasks), 1.0)
        displacement = nearer * rng.uniform(-1, 1, num_tasks)
        displacement *= self.displacement_over_reach * reach
        displacement += DRIFT * reach * velocities.sum(axis=0) / speed
        start = np.zeros(num_tasks)
        states = np.column_stack([start, velocities[0], displacement, velocities[1]])
        return Tasks(states, plants, np.zeros((num_tasks, len(Spread._fields))))

    @property
    def coverage(self) -> Coverage:
        """The machines and tasks that a model which is trained on these covers."""
        speed = self.velocity_over_speed
        displacement = self.displacement_over_reach + 2 * DRIFT * speed
        damping, ratio = self.damping_times_horizon, self.direction_ratio
        return Coverage(
            {
                "displacement_over_reach": (-displacement, displacement),
                "initial_velocity_over_speed": (-speed, speed),
                "target_velocity_over_speed": (-speed, speed),
                "static_forward_over_limit": self.static_over_limit,
                "static_backward_over_limit": self.static_over_limit,
                "static_backward_over_forward": (1.0 / ratio, ratio),
                "coulomb_over_static_forward": self.coulomb_over_static,
                "coulomb_over_static_backward": self.coulomb_over_static,
                "damping_forward_times_horizon": damping,
                "damping_backward_times_horizon": damping,
                "bias_over_limit": (-self.bias_over_limit, self.bias_over_limit),
                "velocity_threshold_over_step": self.threshold_over_step,
                "stribeck_over_step": (0.0, self.stribeck_over_step[1]),
            }
        )

    def _sample_plants(self, size: int, horizon: int, rng: np.random.Generator) -> FloatArray:
        """Draw plants (N, 15) with limits -1 and 1 and gain 1."""
        same = rng.random(size) < HALF
        ratios = (1.0 / self.direction_ratio, self.direction_ratio)
        static = np.where(
            rng.random(size) < 2 / 3,
            rng.uniform(*self.static_over_limit, size),
            _log_uniform(self.static_over_limit, size, rng),
        )
        ratio = np.where(same, 1.0, _log_uniform(ratios, size, rng))
        static_backward = np.clip(static * ratio, *self.static_over_limit)
        coulomb = rng.uniform(*self.coulomb_over_static, (2, size))
        coulomb[1] = np.where(same, coulomb[0], coulomb[1])
        part = rng.choice([1.0, 0.1, 1.0 / 80.0], size)
        most = min(self.damping_times_horizon[1] / horizon, MOST_DAMPING)
        damping = part * rng.uniform(*self.damping_times_horizon, size) / horizon
        ratio = np.where(same, 1.0, _log_uniform(ratios, size, rng))
        weakens = rng.random(size) < self.stribeck_share
        stribeck = np.where(weakens, _log_uniform(self.stribeck_over_step, size, rng), 0.0)
        fields: dict[str, Any] = {
            "static_forward": static,
            "static_backward": static_backward,
            "coulomb_forward": static * coulomb[0],
            "coulomb_backward": static_backward * coulomb[1],
            "damping_forward": np.minimum(damping, most),
            "damping_backward": np.minimum(damping * ratio, most),
            "breakaway_forward": static * np.where(weakens, 1.0, coulomb[0]),
            "breakaway_backward": static_backward * np.where(weakens, 1.0, coulomb[1]),
            "stribeck_velocity": stribeck,
            "bias": np.where(
                rng.random(size) < HALF, 0.0, self.bias_over_limit * rng.uniform(-1, 1, size)
            ),
            "control_gain": np.ones(size),
            "lowest_control": -np.ones(size),
            "highest_control": np.ones(size),
            "time_step": np.ones(size),
            "velocity_threshold": _log_uniform(self.threshold_over_step, size, rng),
        }
        reach, speed = scales(Plant(**fields), horizon)
        step = SPEED_OVER_REACH * speed / reach
        fields["time_step"] = step * np.ones(size)
        for rate in ("damping_forward", "damping_backward"):
            fields[rate] = fields[rate] / step
        for velocity in ("stribeck_velocity", "velocity_threshold"):
            fields[velocity] = fields[velocity] * step
        return np.column_stack([fields[name] for name in Plant._fields])


def _log_uniform(bounds: Bounds, size: int, rng: np.random.Generator) -> FloatArray:
    """Draw (N,) uniform in the logarithm."""
    low, high = np.log(bounds).tolist()
    return np.asarray(np.exp(rng.uniform(low, high, size)))
