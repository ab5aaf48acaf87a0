"""Ensembles: what one plan does on several plants."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from tests.planning.plants import machines, systems

TARGET = np.array([0.2, -0.1])


@given(st.lists(systems() | machines(), min_size=1, max_size=4), st.integers(0, 2**32))
def test_each_plant_makes_of_the_controls_what_it_does_alone(
    several: list[System], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    controls, state = rng.uniform(-3, 3, (3, 20)), rng.uniform(-1, 1, 2)
    ensemble = Ensemble.of(several, state)

    errors = ensemble.errors(controls, TARGET)
    moved = ensemble.after(controls[0])

    for s, system in enumerate(several):
        ends = rollout(system, state, controls)[:, -1]
        np.testing.assert_array_equal(errors[:, s], np.linalg.norm(ends - TARGET, axis=-1))
        np.testing.assert_array_equal(moved.states[s], ends[0])
    # On from there, each from its own state.
    both = np.concatenate([controls[0], controls[1]])[np.newaxis]
    np.testing.assert_array_equal(
        moved.errors(controls[1:2], TARGET), ensemble.errors(both, TARGET)
    )


def test_nothing_happens_in_no_time() -> None:
    ensemble = Ensemble.of([System(), System(0.9, 0.5)], np.array([0.3, 0.2]))

    np.testing.assert_array_equal(ensemble.after(np.empty(0)).states, ensemble.states)


def test_a_few_stand_for_all_in_even_steps() -> None:
    plants = np.arange(33.0)[:, np.newaxis]
    ensemble = Ensemble(plants, np.zeros((33, 2)))

    assert ensemble.spread(8).plants.ravel().tolist() == [0, 4, 8, 12, 16, 20, 24, 28]
    assert len(ensemble.spread(50)) == 33
    assert len(ensemble.joined(ensemble.spread(2))) == 35
