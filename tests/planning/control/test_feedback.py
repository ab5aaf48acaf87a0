"""The laws against what they are defined by."""

import numpy as np
import pytest

from app.planning.control import PD, PID, PDFeedforward, TimeOptimalLaw
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.system import System
from tests.planning.control.controllers import run

FREE = System(0.0, 0.0, 0.0, control_limit=100.0, time_step=1e-3, velocity_threshold=1e-6)


def control(
    law: PD | PID | PDFeedforward | TimeOptimalLaw,
    error: float,
    velocity: float,
    model: System | None = None,
) -> float:
    system = model or System(control_limit=1000.0)
    return control_step(law, system, Measurement(-error, velocity), Goal(0.0)).control


def test_pd_is_proportional_and_derivative_in_accelerations() -> None:
    law = PD(proportional=3.0, derivative=2.0, observer=None)
    heavy = System(control_limit=1000.0, control_gain=0.5, bias=0.25)

    assert control(law, 0.4, 0.3) == pytest.approx(3.0 * 0.4 - 2.0 * 0.3)
    assert control(law, 0.4, 0.3, heavy) == pytest.approx((1.2 - 0.6 - 0.25) / 0.5)


def test_without_friction_pd_is_a_damped_oscillator() -> None:
    law = PD(proportional=16.0, derivative=2.0, observer=None, dead_band=1e-9)
    runs = run(law, truth=FREE, model=FREE, target=1.0, steps=1500)
    time = 1e-3 * np.arange(1501)
    decay, rate = 1.0, np.sqrt(16.0 - 1.0)
    exact = 1.0 - np.exp(-decay * time) * (np.cos(rate * time) + np.sin(rate * time) / rate)

    np.testing.assert_allclose(runs.states[0, :, 0], exact, atol=2e-2)


def test_pd_rests_where_its_control_is_below_static_friction() -> None:
    law = PD(proportional=10.0, derivative=5.0, observer=None)
    runs = run(law, truth=System(), target=0.3)

    # Beyond that it would move; an integral takes the rest away.
    assert 0.02 < runs.final_errors[0] <= 0.7 / 10.0
    integrating = PID(proportional=10.0, derivative=5.0, integral=10.0, observer=None)
    assert run(integrating, truth=System(), target=0.3, steps=400).final_errors[0] < 0.01


def test_the_integral_stands_still_at_the_limit() -> None:
    law = PID(proportional=20.0, derivative=1.0, integral=50.0, observer=None)
    memory = None
    for _ in range(100):
        taken = control_step(law, System(), Measurement(0.0, 0.2), Goal(1.0), memory)
        memory = taken.memory
    turned = control_step(law, System(), Measurement(1.1, 0.0), Goal(1.0), memory)

    assert taken.control == 0.9
    assert turned.control == -0.9


def test_the_feedforward_is_friction_in_motion_and_static_friction_at_rest() -> None:
    law = PDFeedforward(proportional=3.0, derivative=2.0, feedforward=1.5, slow=0.01, observer=None)

    assert control(law, 0.4, 0.3) == pytest.approx(1.2 - 0.6 + 1.5 * 0.6)
    assert control(law, 0.4, -0.3) == pytest.approx(1.2 + 0.6 - 1.5 * 0.6)
    assert control(law, 0.4, 0.005) == pytest.approx(1.2 - 0.01 + 1.5 * 0.7)


def test_the_time_optimal_law_brakes_where_full_control_just_stops_the_mass() -> None:
    law = TimeOptimalLaw(braking=1.0, boundary=1e-9, observer=None)
    plain = System(viscous_damping=0.0)
    distance = 0.4**2 / (2 * 1.5)

    assert control(law, 1.01 * distance, 0.4, plain) == 0.9
    assert control(law, 0.99 * distance, 0.4, plain) == -0.9
    assert control(law, -0.1, -0.4, plain) == -0.9 if distance < 0.1 else 0.9


def test_within_the_boundary_its_control_falls_and_a_kick_is_full() -> None:
    soft = TimeOptimalLaw(braking=1.0, boundary=0.1, kicks=False, observer=None)
    kicking = TimeOptimalLaw(braking=1.0, boundary=0.1, kicks=True, observer=None)

    assert control(soft, 0.05, 0.0, System()) == pytest.approx(0.45)
    assert control(kicking, 0.05, 0.0, System()) == 0.9
