"""Logs of simulated machines: drawn by a seed alone, with what is true of each machine."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.identification.excitation import excitation
from app.planning.plant.rollout import rollout_on
from app.planning.plant.system import ByDirection, System
from app.planning.prior import ControlPrior
from app.planning.problem import DEFAULT_HORIZON
from app.wire.identification import IdentifyRequest, Known

Excitation: TypeAlias = Literal["prior", "ramps"]
FRICTION_SHARE, GAIN_SHARE = 0.2, 0.05
"""By which plants differ from the paper's, uniform and independent."""
REST = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Recording:
    """How logs are recorded."""

    excitation: Excitation = "prior"
    """Controls as of the paper's training data, or the excitation that `breakaway identify` has."""
    num_steps: int = 1000
    position_noise: float = 1e-3
    """Standard deviation, m."""
    velocity_noise: float | None = None
    """m/s; None where velocities are not measured."""
    acceleration_noise: float = 0.0
    """m/s^2, white, on the mass itself."""
    between_samples: bool = False
    """Whether the mass moves on between samples, as a machine's does: then a position is that of
    half a time step ago of the plant."""
    by_direction: bool = False
    """Whether Coulomb friction differs by direction."""


def draw_machine(recording: Recording, seed: int, number: int) -> System:
    """Draw a machine around the paper's plant."""
    shares = np.random.default_rng([seed, number, 0]).uniform(-1, 1, 5).tolist()
    nominal = System().plant
    forward = nominal.coulomb_forward * (1.0 + FRICTION_SHARE * shares[0])
    backward = forward
    if recording.by_direction:
        backward = nominal.coulomb_forward * (1.0 + FRICTION_SHARE * shares[4])
    static = nominal.static_forward * (1.0 + FRICTION_SHARE * shares[1])
    return System(
        static_friction=max(static, forward, backward),
        coulomb_friction=ByDirection(forward, backward) if recording.by_direction else forward,
        viscous_damping=nominal.damping_forward * (1.0 + FRICTION_SHARE * shares[2]),
        control_gain=1.0 + GAIN_SHARE * shares[3],
    )


def record(recording: Recording, machine: System, seed: int, number: int) -> IdentifyRequest:
    """Record a log of a machine, as a request to identify it."""
    rng = np.random.default_rng([seed, number, 1])
    controls = _controls(recording, rng)
    # What acts beside the control acts as one: the control's own gain is taken out of it.
    pushed = machine.control_gain * controls
    pushed += recording.acceleration_noise * rng.standard_normal(controls.size)
    plant = machine.plant._replace(control_gain=1.0)
    states = rollout_on(plant, np.array(REST), pushed[np.newaxis])[0]
    positions, velocities = states.T
    if recording.between_samples:
        positions = positions - 0.5 * machine.time_step * velocities
    positions = positions + recording.position_noise * rng.standard_normal(positions.size)
    measured = None
    if recording.velocity_noise is not None:
        noise = recording.velocity_noise * rng.standard_normal(velocities.size)
        measured = (velocities + noise).tolist()
    return IdentifyRequest(
        time_step=machine.time_step,
        controls=controls.tolist(),
        positions=positions.tolist(),
        velocities=measured,
        known=Known(control_limit=machine.control_limit),
        seed=int(rng.integers(2**32)),
    )


def _controls(recording: Recording, rng: np.random.Generator) -> FloatArray:
    nominal = System()
    if recording.excitation == "ramps":
        return np.resize(excitation(nominal), recording.num_steps)
    parts = -(-recording.num_steps // DEFAULT_HORIZON)
    drawn = ControlPrior().sample(parts, DEFAULT_HORIZON, nominal.plant, rng)
    return np.ascontiguousarray(drawn.ravel()[: recording.num_steps])
