"""A machine that moves on between its samples, by Newton's law in small steps, as no plant does."""

import math

from app.planning.plant.system import System

SUBSTEPS = 200


def moved(position: float, velocity: float, control: float, system: System) -> tuple[float, float]:
    """Return position (m) and velocity (m/s) after a time step in which `control` is held.

    Of a system whose frictions are the same both ways. Where the mass stops it goes on in the same
    step, if the control is strong enough.
    """
    plant, step = system.plant, system.time_step / SUBSTEPS
    force = plant.control_gain * control + plant.bias
    for _ in range(SUBSTEPS):
        if velocity == 0.0 and abs(force) <= plant.static_forward:
            break
        way = velocity if velocity != 0.0 else force
        friction = math.copysign(plant.coulomb_forward, way)
        after = velocity + step * (force - friction - plant.damping_forward * velocity)
        if after * way <= 0.0:
            after = 0.0
        position += 0.5 * step * (velocity + after)
        velocity = after
    return position, velocity
