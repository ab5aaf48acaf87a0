"""Which plants a request means that says what is uncertain."""

import numpy as np
import pytest

from app.planning.plant.system import ControlLimits, System
from app.planning.uncertainty.risk import Risk
from app.planning.uncertainty.uncertainty import NUM_JUDGES
from app.serving.ensembles import uncertainty_of
from app.serving.refusals import InvalidField
from app.wire.uncertainty import Uncertainty

STATE = (0.1, -0.2)


def test_given_plants_are_taken_as_they_are() -> None:
    # The same limits, said otherwise.
    others = [System(), System(control_gain=1.1, control_limit=ControlLimits(-0.9, 0.9))]
    asked = Uncertainty(systems=others, risk="worst", num_motions=5)
    uncertainty = uncertainty_of(asked, System(), STATE, 7)

    np.testing.assert_array_equal(uncertainty.ensemble.plants, [s.plant for s in others])
    np.testing.assert_array_equal(uncertainty.ensemble.states, [STATE, STATE])
    assert uncertainty.judges is uncertainty.ensemble
    assert uncertainty.risk == Risk("worst")
    assert uncertainty.num_motions == 5
    assert uncertainty.relative is None


def test_plants_are_drawn_by_the_seed_and_judged_on_others() -> None:
    asked = Uncertainty.model_validate({"relative": {"bias": 0.1, "control_gain": 0.2}})
    one, same, other = (uncertainty_of(asked, System(), STATE, seed) for seed in (7, 7, 8))

    np.testing.assert_array_equal(one.ensemble.plants, same.ensemble.plants)
    np.testing.assert_array_equal(one.judges.plants, same.judges.plants)
    assert np.all(one.ensemble.plants[:, 10] != other.ensemble.plants[:, 10])
    assert len(one.ensemble) == 32
    assert len(one.judges) == NUM_JUDGES
    assert not set(one.ensemble.plants[:, 10]) & set(one.judges.plants[:, 10])
    assert one.corners is not None


@pytest.mark.parametrize(
    ("fields", "pointer"),
    [
        ({"systems": [{}, {"time_step": 0.01}]}, "/uncertainty/systems/1/time_step"),
        ({"systems": [{"control_limit": 0.8}]}, "/uncertainty/systems/0/control_limit"),
        (
            {"relative": {"viscous_damping": 0.5}, "num_systems": 1},
            "/uncertainty/relative/viscous_damping",
        ),
    ],
)
def test_plants_that_no_plan_can_be_for_are_refused(
    fields: dict[str, object], pointer: str
) -> None:
    with pytest.raises(InvalidField) as refused:
        uncertainty_of(Uncertainty.model_validate(fields), System(viscous_damping=15.0), STATE, 7)
    assert refused.value.pointer == pointer
