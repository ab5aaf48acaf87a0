"""What a model is told of an ensemble, and what it is not."""

from dataclasses import replace

import numpy as np
import pytest

from app.planning.plant.spread import Spread
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.told import tell
from app.planning.uncertainty.uncertainty import Uncertainty

SYSTEM = System()
MOST = Spread(0.2, 0.2, 0.2, 0.1)
REST = np.zeros(2)


def drawn(relative: Relative) -> Uncertainty:
    plants = relative.draw(SYSTEM, 64, np.random.default_rng(0))
    ensemble = Ensemble.at(plants, REST)
    return Uncertainty(ensemble, ensemble, relative=relative)


def given(*systems: System) -> Uncertainty:
    ensemble = Ensemble.of(systems, REST)
    return Uncertainty(ensemble, ensemble)


def test_shares_that_the_model_knows_are_told_as_they_are() -> None:
    told = tell(drawn(Relative(0.1, 0.15, 0.05, control_gain=0.02)), SYSTEM.plant, MOST)

    assert told.spread == Spread(0.1, 0.15, 0.05, 0.02)
    assert told.left_out == ()


def test_of_larger_shares_the_nearest_are_told() -> None:
    told = tell(drawn(Relative(0.1, 0.5, control_gain=0.3)), SYSTEM.plant, MOST)

    assert told.spread == Spread(0.1, 0.2, 0.0, 0.1)
    assert told.left_out == (
        "coulomb_friction may be off by 50%, the model knows up to 20%",
        "control_gain may be off by 30%, the model knows up to 10%",
    )


def test_given_plants_are_told_by_their_spread() -> None:
    plants = drawn(Relative(coulomb_friction=0.1, control_gain=0.05)).ensemble
    told = tell(Uncertainty(plants, plants), SYSTEM.plant, MOST)

    assert told.spread.coulomb_friction == pytest.approx(0.1, rel=0.05)
    assert told.spread.control_gain == pytest.approx(0.05, rel=0.05)
    assert told.left_out == ()


def test_what_has_no_share_is_said() -> None:
    systems = [replace(SYSTEM, bias=bias) for bias in (-0.1, 0.1)]

    assert tell(given(*systems), SYSTEM.plant, MOST).left_out == (
        "bias differs, of which the model knows nothing",
    )


def test_plants_that_lie_to_one_side_are_said_to() -> None:
    systems = [replace(SYSTEM, control_gain=gain) for gain in (1.04, 1.06)]

    told = tell(given(*systems), SYSTEM.plant, MOST)

    assert told.left_out == (
        "control_gain differs in the mean, which the model takes to be the plant's own",
    )
