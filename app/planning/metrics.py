"""The paper's measures of a plan (Sect. 4.5), each of one plan or of a stack of them.

And one measure of a plan's candidates.
"""

import numpy as np

from app.planning.arrays import FloatArray, IntArray
from app.planning.plant.rollout import are_stuck
from app.planning.plant.system import System

POSITION_TOLERANCE = 0.01
"""delta, m: a mass closer to its target than this is not stuck, it has arrived."""


def terminal_error(terminal_states: FloatArray, target_state: FloatArray) -> FloatArray:
    """Return ||x_H - x*||_2 of states (..., 2): shape (...) (paper, Eq. 5)."""
    return np.asarray(np.linalg.norm(terminal_states - target_state, axis=-1))


def control_energy(controls: FloatArray) -> FloatArray:
    """Return E_u = sum_k u_k^2 of controls (..., H), in squared units of control: shape (...)."""
    return np.asarray(np.sum(controls**2, axis=-1))


def control_smoothness(controls: FloatArray) -> FloatArray:
    """Return S_u = sum_k (u_{k+1} - u_k)^2 of controls (..., H), in squared units of control."""
    return np.asarray(np.sum(np.diff(controls, axis=-1) ** 2, axis=-1))


def diversity(controls: FloatArray) -> float:
    """Return how far K candidates (K, H) lie apart, in units of control: 0 where all are alike.

    The standard deviation over the candidates, its root mean square over the steps.
    """
    # As numpy's own `var`, to the bit, in a third of the time.
    count = len(controls)
    deviations = controls - np.add.reduce(controls) / count
    variances = np.add.reduce(deviations * deviations) / count
    return float(np.sqrt(np.add.reduce(variances) / variances.size))


def stuck_steps(
    states: FloatArray, controls: FloatArray, target_position: float | FloatArray, system: System
) -> IntArray:
    """Return N_stuck: stuck steps off the target (paper, Sect. 4.5).

    Args:
        states: (..., H+1, 2); the last state, which no control follows, does not count.
        controls: (..., H).
        target_position: p*, m: one, or an array that goes with the controls.
        system: the plant.
    """
    position, velocity = states[..., :-1, 0], states[..., :-1, 1]
    stuck = are_stuck(velocity.ravel(), controls.ravel(), system.plant).reshape(controls.shape)
    off_target = np.abs(position - target_position) > POSITION_TOLERANCE
    return np.asarray(np.count_nonzero(stuck & off_target, axis=-1))
