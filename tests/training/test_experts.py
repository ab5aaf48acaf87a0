import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.metrics import terminal_error
from app.planning.plant.rollout import rollout
from app.planning.prior import ControlPrior
from app.planning.reachable.reachability import reachability
from training.experts import Experts, Kind, Plans, draw_plans
from training.machines import RandomMachines

HORIZON = 32


def plans_of(kind: Kind, **changes: object) -> Plans:
    shares = {"rollout": 0.0, "exact": 0.0, "least_energy": 0.0, "margin": 0.0, kind: 1.0}
    experts = Experts.model_validate(
        {"static_margin": 0.1, "num_candidates": 2, **shares, **changes}
    )
    rng = np.random.default_rng(0)
    return draw_plans(RandomMachines(), experts, ControlPrior(), 30, HORIZON, rng)


def errors(plans: Plans) -> FloatArray:
    ends = []
    for i, controls in enumerate(plans.controls):
        problem = plans.tasks.problem(i, HORIZON)
        ends.append(rollout(problem.system, problem.initial_state, controls[np.newaxis])[0, -1])
    return terminal_error(np.array(ends), plans.tasks.states[:, 2:])


def test_a_rollout_is_a_plan_for_where_it_ends() -> None:
    np.testing.assert_array_equal(errors(plans_of("rollout")), 0.0)


@pytest.mark.parametrize("kind", ["exact", "least_energy", "margin"])
def test_an_expert_ends_as_near_to_its_target_as_the_machine_can(kind: Kind) -> None:
    plans = plans_of(kind)
    floors = np.array([reachability(plans.tasks.problem(i, HORIZON)).floor for i in range(30)])

    # What is planned with a margin may have a motion from which the last bit is not to be had.
    assert np.mean(errors(plans) <= floors + 1e-6) >= (0.8 if kind == "margin" else 1.0)
    assert np.abs(plans.controls).max() <= 1.0
    assert 0.0 < np.mean(floors > 0) < 0.6


def test_the_least_energy_is_less_than_that_of_any_exact_plan() -> None:
    exact, least = plans_of("exact"), plans_of("least_energy")

    assert np.sum(least.controls**2) < 0.9 * np.sum(exact.controls**2)


def test_shares_must_add_up_to_one() -> None:
    with pytest.raises(ValueError, match="add up"):
        plans_of("exact", rollout=0.5)
