"""Rests of a plan: a mass that does not move is not pushed.

A push below the static friction that a plan was made with sets off a mass that has less of it.
"""

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.friction import holding_control
from app.planning.plant.system import Plant
from app.planning.uncertainty.ensemble import Ensemble


def without_idle_pushes(controls: FloatArray, ensemble: Ensemble, plant: Plant) -> FloatArray:
    """Return `controls` (H,) with what holds the mass in place of what does not move it.

    That is in the steps before and after which every plant of the ensemble rests; none of them
    moves otherwise than before.

    Args:
        controls: of a plan.
        ensemble: the plants that it is made for.
        plant: whose control nearest to none holds the mass.
    """
    states = ensemble.trajectories(controls)
    rests = np.all(states[:, :, 1] == 0.0, axis=0)
    eased = np.where(rests[:-1] & rests[1:], holding_control(plant), controls)
    return eased if np.array_equal(ensemble.trajectories(eased), states) else controls
