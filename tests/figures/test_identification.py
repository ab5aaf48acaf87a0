"""The picture of an identification shows the log, what is predicted of it, and the friction."""

from pathlib import Path

import numpy as np
import pytest

from app.evaluation.logs import Recording, draw_machine, record
from app.figures.identification import draw_identification, friction_curve
from app.planning.plant.system import ByDirection, System
from app.serving.identification import IdentificationService
from app.serving.rates import Rates
from app.settings import Settings
from app.wire.identification import IdentifyRequest, IdentifyResponse

RECORDING = Recording(num_steps=300)
REQUEST = record(RECORDING, draw_machine(RECORDING, 0, 1), 0, 1)


@pytest.fixture(scope="module")
def answer() -> IdentifyResponse:
    service = IdentificationService(Settings(), Rates())
    return service.identify(service.resolve(REQUEST))


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_it_is_drawn(tmp_path: Path, answer: IdentifyResponse, ending: str) -> None:
    path = tmp_path / f"identification.{ending}"
    draw_identification(REQUEST, answer).savefig(path)
    assert path.stat().st_size > 1000


def test_it_shows_what_was_measured_and_what_the_plant_makes_of_it(
    answer: IdentifyResponse,
) -> None:
    positions, errors, friction = draw_identification(REQUEST, answer).axes
    measured, *predicted = positions.lines
    np.testing.assert_allclose(np.asarray(measured.get_ydata(), float), np.array(REQUEST.positions))
    times, ends = np.array([np.asarray(line.get_xydata())[-1] for line in predicted[:-1]]).T
    at = np.rint(times / REQUEST.time_step).astype(int)
    off = ends - np.array(REQUEST.positions)[at]
    assert np.sqrt(np.mean(off**2)) == pytest.approx(answer.fit.end_error_rms, rel=0.2)
    shown = np.array([np.asarray(line.get_ydata())[-1] for line in errors.lines[1:]])
    np.testing.assert_allclose(shown, 1e3 * off)
    assert friction.get_xlabel() == "velocity (m/s)"


def test_friction_opposes_motion_by_direction() -> None:
    system = System(ByDirection(0.7, 0.9), ByDirection(0.6, 0.8), ByDirection(0.1, 0.2))
    speeds = np.array([0.5, 1.0])
    np.testing.assert_allclose(friction_curve(system, 1.0, speeds), [0.65, 0.7])
    np.testing.assert_allclose(friction_curve(system, -1.0, speeds), [-0.9, -1.0])


def test_a_request_with_velocities_is_drawn_as_well() -> None:
    recording = Recording(num_steps=200, velocity_noise=1e-2)
    request: IdentifyRequest = record(recording, draw_machine(recording, 0, 2), 0, 2)
    service = IdentificationService(Settings(), Rates())
    draw_identification(request, service.identify(service.resolve(request)))
