"""The descent of a risk over several plants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.plant.system import System
from app.planning.stop import NEVER
from app.planning.uncertainty.descent import descend_risk
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.motions import draw_motions
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.risk import MEAN, Risk
from tests.planning.fakes import stopped
from tests.planning.plants import machines, systems

TARGET = np.array([0.3, 0.0])
SHARES = Relative(static_friction=0.1, coulomb_friction=0.1, control_gain=0.05)
RISKS = [MEAN, Risk("worst"), Risk("cvar", 0.8)]


def around(system: System, count: int = 12, seed: int = 0) -> Ensemble:
    return Ensemble.at(SHARES.draw(system, count, np.random.default_rng(seed)), np.zeros(2))


@given(systems() | machines(), st.integers(0, 2**32), st.booleans())
def test_the_risk_never_grows_and_the_limits_hold(system: System, seed: int, squared: bool) -> None:
    plant = system.plant
    rng = np.random.default_rng(seed)
    before = rng.uniform(plant.lowest_control, plant.highest_control, 24)
    ensemble = around(system, 5, seed)
    for risk in RISKS:
        controls = before.copy()
        value, rollouts = descend_risk(
            controls, ensemble.scenarios(TARGET), risk.num_counted(5), squared, 10, NEVER.flag
        )
        start, end = ensemble.errors(np.array([before, controls]), TARGET)
        if squared:
            assert value == pytest.approx(np.mean(end**2))
            assert np.mean(end**2) <= np.mean(start**2)
        else:
            assert value == pytest.approx(risk.of(end))
            assert risk.of(end) <= risk.of(start)
        assert plant.lowest_control <= controls.min() <= controls.max() <= plant.highest_control
        assert rollouts >= 5


@pytest.mark.parametrize("num_plants", [2, 12, 60])
def test_it_comes_to_where_the_squares_have_no_slope(num_plants: int) -> None:
    # With fewer residuals than controls and with more.
    ensemble = around(System(), num_plants)
    controls = np.repeat([0.9, -0.5, 0.8, -0.1], 16)
    descend_risk(controls, ensemble.scenarios(TARGET), 1.0, True, 300, NEVER.flag)

    def loss(changed: np.ndarray) -> float:
        return float(np.mean(ensemble.errors(changed[np.newaxis], TARGET) ** 2))

    least = loss(controls)
    rng = np.random.default_rng(0)
    for scale in (1e-3, 1e-2):
        moved = np.clip(controls + scale * rng.standard_normal((200, 64)), -0.9, 0.9)
        assert min(map(loss, moved)) > 0.99 * least


def test_one_plant_is_arrived_at_exactly() -> None:
    ensemble = Ensemble.of([System()], np.zeros(2))
    controls = np.repeat([0.9, -0.5, 0.0], [20, 20, 24])
    risk, _ = descend_risk(controls, ensemble.scenarios(TARGET), 1.0, True, 100, NEVER.flag)

    assert risk < 1e-20


@pytest.mark.parametrize("risk", RISKS, ids=lambda risk: risk.name)
def test_the_risk_itself_goes_below_what_the_squares_make_of_it(risk: Risk) -> None:
    ensemble = around(System(), 32)
    scenarios, counted = ensemble.scenarios(TARGET), risk.num_counted(32)
    starts = draw_motions(np.random.default_rng(0), 20, 64, System().plant)
    for controls in starts:
        descend_risk(controls, scenarios, counted, True, 100, NEVER.flag)
    squares = risk.of(ensemble.errors(starts, TARGET))
    for controls in starts:
        descend_risk(controls, scenarios, counted, False, 100, NEVER.flag)
    values = risk.of(ensemble.errors(starts, TARGET))

    assert np.all(values <= squares)
    assert np.mean(values) < 0.99 * np.mean(squares)


def test_a_stop_is_heeded() -> None:
    controls = np.repeat([0.9, -0.5], 32)
    before = controls.copy()
    scenarios = around(System()).scenarios(TARGET)
    _, rollouts = descend_risk(controls, scenarios, 12.0, True, 40, stopped().flag)

    assert rollouts == 12
    np.testing.assert_array_equal(controls, before)
