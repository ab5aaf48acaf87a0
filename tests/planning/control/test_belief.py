"""What is believed of a plant: the model with what was learned, which can be forgotten again."""

import numpy as np
import pytest

from app.planning.control import RecedingHorizon
from app.planning.control.belief import believed, forget
from app.planning.control.memory import BIAS, COULOMB, FORWARD, GAIN, LEAST, MOST, Memory
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.system import Plant, System
from tests.planning.control.controllers import EXACT

MODEL = System().plant
SETTINGS = RecedingHorizon(observer=EXACT).settings(MODEL)


def begun(doubt: float = 1.0) -> Memory:
    """Return the memory of a controller that has learned nothing."""
    memory = Memory.empty()
    forget(memory, MODEL, SETTINGS, doubt)
    return memory


def belief(memory: Memory, caution: float = 0.5) -> Plant:
    return believed(MODEL, memory, caution, MODEL.velocity_threshold)


def test_nothing_learned_it_is_the_model() -> None:
    assert belief(begun()) == MODEL
    assert belief(begun(), 1.0).static_forward == pytest.approx(1.2 * 0.7)


def test_what_was_learned_is_forgotten_whole_and_the_state_is_not() -> None:
    memory = begun()
    memory.mean[:] = (0.1, 0.2, 1.05, 1.3, 0.8, 0.2)
    memory.covariance[:] = np.eye(6) + 0.1
    memory.statics[FORWARD] = 0.75, 0.76
    forget(memory, MODEL, SETTINGS, 2.0)

    np.testing.assert_array_equal(memory.mean, (0.1, 0.2, 1.0, 1.0, 1.0, 0.0))
    np.testing.assert_array_equal(memory.covariance[:2, :2], np.eye(2) + 0.1)
    assert np.all(memory.covariance[:2, 2:] == 0.0)
    doubted = 2.0 * np.array([0.05, 0.2, 0.2, 0.12]) / 3**0.5
    np.testing.assert_allclose(memory.covariance[2:, 2:], np.diag(doubted**2))
    np.testing.assert_array_equal(memory.statics, begun().statics)


def test_static_friction_is_no_less_than_the_coulomb_friction_that_was_learned() -> None:
    memory = begun()
    memory.mean[COULOMB] = 1.2

    assert belief(memory).coulomb_forward == pytest.approx(0.72)
    assert belief(memory).static_forward == pytest.approx(0.72)


def test_what_full_control_moves_by_the_model_it_is_believed_to_move() -> None:
    # A push that has held the mass may be over, and nothing but a try would tell.
    held = begun()
    held.mean[GAIN], held.mean[BIAS] = 0.9, -0.3
    held.statics[FORWARD, LEAST] = held.statics[FORWARD, MOST] = 0.84
    weak = System(control_limit=0.6).plant
    of_weak = Memory.empty()
    forget(of_weak, weak, RecedingHorizon(observer=EXACT).settings(weak), 1.0)

    assert belief(held).static_forward < 0.9 * 0.9 - 0.3
    assert believed(weak, of_weak, 0.5, 1e-3).static_forward == 0.7


def test_static_friction_is_never_believed_to_be_beyond_full_control() -> None:
    stuck = RecedingHorizon(observer=EXACT)
    memory = None
    for _ in range(30):
        # Nothing ever moves.
        taken = control_step(stuck, System(), Measurement(0.0, 0.0), Goal(0.3), memory)
        memory = taken.memory
    assert taken.control > 0.85
    assert taken.estimate.system.plant.static_forward < 0.9
