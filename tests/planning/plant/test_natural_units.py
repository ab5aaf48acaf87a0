"""In natural units plants that move alike are the same, and so are their plans."""

from dataclasses import replace

import numpy as np
import pytest

from app.planning.plant.machines import MACHINES, Machine
from app.planning.plant.natural_units import in_natural_units, natural_units, scales
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ControlLimits, Plant, System

every_machine = pytest.mark.parametrize("machine", MACHINES.values(), ids=list(MACHINES))


def system_of(plant: Plant) -> System:
    """The plant in natural units, for one that is the same both ways."""
    return System(
        plant.static_forward,
        plant.coulomb_forward,
        plant.damping_forward,
        stribeck_velocity=plant.stribeck_velocity or None,
        bias=plant.bias,
        control_limit=1.0,
        time_step=1.0,
        velocity_threshold=plant.velocity_threshold,
    )


@pytest.mark.parametrize(
    "system",
    [
        System(),
        MACHINES["rack_and_pinion"].system,
        MACHINES["servo"].system,
        System(control_limit=ControlLimits(-0.8, 1.4), bias=-0.2, control_gain=1.3),
    ],
)
def test_a_rollout_in_natural_units_is_the_rollout(system: System) -> None:
    units = natural_units(system.plant)
    controls = np.random.default_rng(0).uniform(-1, 1, (8, 64)).cumsum(axis=1).clip(-1, 1)
    start = np.array([0.3, 5.0])

    natural = rollout(system_of(in_natural_units(system.plant)), start, controls)
    own = rollout(
        system,
        start * [units.position, units.velocity],
        units.middle + units.control * controls,
    )

    assert np.ptp(natural[:, -1, 0]) > 1
    np.testing.assert_allclose(own / [units.position, units.velocity], natural, atol=1e-8)


@every_machine
def test_natural_units_of_natural_units_are_one(machine: Machine) -> None:
    natural = in_natural_units(machine.system.plant)

    np.testing.assert_allclose(in_natural_units(natural), natural, rtol=1e-12)
    assert tuple(natural_units(natural)) == (0.0, 1.0, 1.0, 1.0)


def test_the_limits_of_the_papers_plant_are_its_unit_to_the_bit() -> None:
    assert natural_units(System().plant)[:2] == (0.0, 0.9)


@every_machine
def test_scales_are_about_what_full_control_reaches(machine: Machine) -> None:
    plant = machine.system.plant
    reach, speed = scales(plant, 64)
    farthest, fastest = 0.0, 0.0
    for highest, lowest in (
        (plant.highest_control, plant.lowest_control),
        (plant.lowest_control, plant.highest_control),
    ):
        controls = np.full((63, 64), lowest)
        controls[np.arange(64) < np.arange(1, 64)[:, None]] = highest
        states = rollout(machine.system, np.zeros(2), controls)
        # The last switch that still lets the mass come to rest, or turn.
        turns = (np.sign(highest) * states[:, -1, 1] <= 0).nonzero()[0]
        farthest = max(farthest, np.abs(states[turns][..., 0]).max())
        fastest = max(fastest, np.abs(states[turns][..., 1]).max())
    assert 0.5 < reach / farthest < 2
    assert 0.3 < speed / fastest < 2


def test_scales_of_many_plants_are_those_of_each() -> None:
    plants = [machine.system.plant for machine in MACHINES.values()]
    together = scales(Plant(*np.array(plants).T), 48)

    np.testing.assert_allclose(
        np.transpose(together), [scales(plant, 48) for plant in plants], rtol=1e-12
    )


def test_a_plant_that_full_control_hardly_moves_has_scales_all_the_same() -> None:
    stiff = replace(System(), static_friction=5.0, coulomb_friction=5.0)

    assert all(0 < scale < np.inf for scale in scales(stiff.plant, 64))
