"""What a plan is worth on uncertain plants."""

import numpy as np
import pytest

from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.risk import Risk
from app.planning.uncertainty.robustness import judge
from app.planning.uncertainty.uncertainty import Uncertainty

PROBLEM = Problem(np.zeros(2), np.array([0.2, 0.0]))
CONTROLS = np.repeat([0.9, -0.2, 0.0], [14, 20, 30])


def test_it_is_measured_on_the_plants_that_judge() -> None:
    made_for = Ensemble.of([System()], PROBLEM.initial_state)
    systems = [System(coulomb_friction=0.5 + 0.01 * i) for i in range(20)]
    judges = Ensemble.of(systems, PROBLEM.initial_state)
    risk = Risk("cvar", 0.9)
    robustness = judge(PROBLEM, CONTROLS, 0.123, Uncertainty(made_for, judges, risk=risk))

    errors = np.sort(judges.errors(CONTROLS[np.newaxis], PROBLEM.target_state)[0])
    assert robustness.num_systems == 20
    assert robustness.risk == risk
    assert robustness.value == pytest.approx(errors[-2:].mean())
    assert robustness.mean_error == pytest.approx(errors.mean())
    assert robustness.median_error == pytest.approx((errors[9] + errors[10]) / 2)
    assert errors[-3] <= robustness.p90_error <= errors[-2]
    assert robustness.worst_error == errors[-1]
    assert robustness.rms_error == pytest.approx(np.linalg.norm(errors) / 20**0.5)
    assert robustness.within == {
        "0.01": np.mean(errors <= 0.01),
        "0.05": np.mean(errors <= 0.05),
    }
    assert robustness.nominal_error == 0.123
    assert robustness.first_order_bound is None


def test_the_bound_holds_where_every_plant_starts_from_the_same_rest() -> None:
    relative = Relative(coulomb_friction=0.1, control_gain=0.05)
    plants = relative.draw(System(), 4, np.random.default_rng(0))
    ensemble = Ensemble.at(plants, PROBLEM.initial_state)
    uncertainty = Uncertainty(ensemble, ensemble, relative=relative)

    known = judge(PROBLEM, CONTROLS, 0.0, uncertainty).first_order_bound
    assert known == relative.least_rms_error(PROBLEM)
    later = uncertainty.after(np.full(20, 0.9)).after(np.full(40, 0.0))
    assert judge(PROBLEM, CONTROLS, 0.0, later).first_order_bound is None
