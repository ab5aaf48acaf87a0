"""A controller with all its options as the kernels take it."""

from typing import NamedTuple

RECEDING_HORIZON, FEEDBACK, SWITCHING, SEQUENCE = range(4)
"""The kinds of controllers: what makes the control of a step."""


class Settings(NamedTuple):
    """Flat, since every call of a kernel from Python pays for each tuple within a tuple.

    What a kind does not know has its default.
    """

    kind: int
    dead_band: float = 0.0
    """m: at rest nearer than this to the target the mass is held."""
    # The receding horizon.
    replan_every: int = 1
    least_horizon: int = 10
    margin: float = 1.0
    iterations: int = 5
    saves_energy: bool = False
    # Feedback laws.
    proportional: float = 0.0
    """1/s^2: accelerations, so that the unit of the control does not matter."""
    integral: float = 0.0
    """1/s^3."""
    derivative: float = 0.0
    """1/s."""
    feedforward: float = 0.0
    """Share of the friction that is fed forward."""
    slow: float = 0.0
    """m/s: slower than this, the feedforward is static friction towards the target."""
    braking: float = 1.0
    """Share of the model's braking that a switching law counts on."""
    boundary: float = 0.0
    """m: within so much of the switching curve the control falls in proportion."""
    kicks: bool = False
    """Whether a switching law leaves rest with full control."""
    # The observer.
    observes: bool = False
    position_variance: float = 0.0
    position_lag: float = 0.0
    """s: measured positions are those of so long ago."""
    velocity_variance: float = 0.0
    acceleration_noise: float = 0.0
    rest_velocity: float = 0.0
    # What may be wrong with the model, as an observer begins.
    gain_variance: float = 0.0
    """Of a factor, as the next two."""
    coulomb_variance: float = 0.0
    damping_variance: float = 0.0
    bias_variance: float = 0.0
    """(m/s^2)^2."""
    static_share: float = 0.0
    """Of its static friction."""
