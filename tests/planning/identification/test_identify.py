"""From a log to a plant: recovered, covered by its intervals, and what cannot be told is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.evaluation.logs import Recording
from app.planning.arrays import FloatArray
from app.planning.identification.advice import is_reversed
from app.planning.identification.excitation import excitation
from app.planning.identification.identify import Question, identify
from app.planning.identification.log import Log
from app.planning.identification.log_checks import UnusableLog, checked_log
from app.planning.identification.verdict import Identification
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, System
from app.planning.stop import Stop, Stopped
from tests.planning.identification.recordings import (
    log_of,
    positions_between_samples,
    recorded,
    truth,
)

LIMIT = {"control_limit": 0.9}
SLIDING = ("control_gain", "coulomb_friction", "viscous_damping", "bias")
"""What shows while a mass slides; static friction is only bracketed."""


def found(log: Log, seed: int = 0, **asked: Any) -> Identification:
    known = LIMIT | asked.pop("known", {})
    return identify(log, Question(known=known, **asked), np.random.default_rng(seed))


def pushes(num_steps: int, seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-0.9, 0.9, num_steps // 10), 10)


@pytest.mark.parametrize(
    "system",
    [
        System(),
        System(0.8, 0.5, 0.06, bias=0.05, control_gain=1.1),
        System(0.75, ByDirection(0.65, 0.5), ByDirection(0.1, 0.3)),
    ],
)
def test_a_noiseless_plant_is_recovered(system: System) -> None:
    identified = found(log_of(system, pushes(600)), by_direction=not system.is_same_both_ways)
    for parameter in identified.parameters:
        if parameter.name.partition(".")[0] in SLIDING:
            assert parameter.value == pytest.approx(truth(system, parameter.name), abs=1e-6)
        else:
            assert parameter.value == pytest.approx(truth(system, parameter.name), abs=0.05)
    assert (identified.delay_steps, identified.position_lag) == (0, 0.0)


COUNT = 1e-4
"""Of an encoder, m."""


@pytest.mark.parametrize("seed", [0, 1])
def test_a_machine_moves_between_its_samples(seed: int) -> None:
    machine = System(1.28, 1.02, 0.4, control_gain=0.45, control_limit=8.0, time_step=0.02)
    controls = excitation(machine)
    positions = positions_between_samples(machine, controls)
    log = checked_log(machine.time_step, controls, COUNT * np.round(positions / COUNT), None)

    identified = found(log, seed, known={"control_limit": 8.0})

    assert (identified.delay_steps, identified.position_lag) == (0, 0.01)
    for parameter in identified.parameters:
        assert parameter.value == pytest.approx(truth(machine, parameter.name), rel=0.01, abs=2e-3)
    assert identified.quality.end_error_rms < 1e-3
    # Without the lag what positions say of the motion cannot be right.
    assert found(log, seed, position_lag=0.0).quality.end_error_rms > 3e-3


def covered(machine: System, identified: Identification) -> list[bool]:
    return [
        low <= truth(machine, parameter.name) <= high
        for parameter in identified.parameters
        for low, high in [parameter.interval]
    ]


def test_a_slow_ramp_tells_static_friction() -> None:
    # Chance that sets the mass off late explains this log, too, and is less likely by far.
    machine = System(0.26, 0.215, 1.2, control_gain=0.37, control_limit=10.0, time_step=0.01)
    controls = excitation(machine)
    states = rollout(machine, np.zeros(2), controls[np.newaxis])[0]
    noise = 2e-5 * np.random.default_rng(0).standard_normal(len(states))

    identified = found(
        checked_log(machine.time_step, controls, states[:, 0] + noise, None),
        known={"control_limit": 10.0},
    )

    assert identified.system.static_friction == pytest.approx(0.26, abs=1e-3)


def test_a_few_machines_are_found_and_covered() -> None:
    errors, within = [], []
    for number in range(5):
        machine, log = recorded(Recording(num_steps=500), number)
        identified = found(log)
        errors.append(
            abs(truth(identified.system, "coulomb_friction") - truth(machine, "coulomb_friction"))
        )
        within += covered(machine, identified)
    assert np.median(errors) < 0.01
    assert np.mean(within) > 0.7


@pytest.mark.slow
def test_intervals_cover_what_they_claim() -> None:
    within, errors = [], []
    for number in range(200):
        machine, log = recorded(Recording(), number)
        identified = found(log, seed=number)
        within += covered(machine, identified)
        errors.append(
            abs(truth(identified.system, "coulomb_friction") - truth(machine, "coulomb_friction"))
        )
    assert 0.90 <= np.mean(within) <= 0.98
    assert np.median(errors) <= 0.004


def test_the_delay_is_found_and_may_be_known() -> None:
    log = log_of(System(), pushes(400), 1e-4, delay_steps=2)
    assert found(log).delay_steps == 2
    assert found(log, delay_steps=2).delay_steps == 2
    with pytest.raises(UnusableLog, match="from 0 to a time step"):
        Question(position_lag=0.06).check(log)
    # One sample less moves the gain.
    wrong = found(log, delay_steps=1)
    assert abs(wrong.system.control_gain - 1.0) > 0.02


def test_the_same_seed_gives_the_same_answer_another_one_nearly_so() -> None:
    _, log = recorded(Recording(num_steps=300), 2)
    one, again, other = found(log), found(log), found(log, seed=1)
    assert (one.system, one.parameters, one.systems) == (
        again.system,
        again.parameters,
        again.systems,
    )
    assert one.parameters != other.parameters
    assert one.system.control_gain == pytest.approx(other.system.control_gain, rel=0.02)


def test_what_is_known_stays_and_is_not_reported() -> None:
    system = System(0.8, 0.5, 0.06)
    identified = found(
        log_of(system, pushes(300), 1e-4), known={"coulomb_friction": 0.5, "bias": 0.0}
    )
    assert identified.system.coulomb_friction == 0.5
    assert identified.system.bias == 0.0
    names = {parameter.name for parameter in identified.parameters}
    assert names == {"control_gain", "static_friction", "viscous_damping"}


def test_the_ensemble_is_of_plants_that_can_be_and_lies_around_the_estimate() -> None:
    _, log = recorded(Recording(num_steps=300), 3)
    identified = found(log, num_systems=64)
    assert len(identified.systems) == 64
    gains = [system.control_gain for system in identified.systems]
    gain = next(p for p in identified.parameters if p.name == "control_gain")
    assert np.mean(gains) == pytest.approx(gain.value, abs=2 * gain.standard_error)
    assert np.std(gains) == pytest.approx(gain.standard_error, rel=0.5)
    for system in identified.systems:
        assert system.time_step == identified.system.time_step
        assert system.control_limit == identified.system.control_limit


def test_frictions_that_differ_are_told_apart_from_those_that_do_not() -> None:
    same = System(0.7, 0.6, 0.05)
    differing = System(ByDirection(0.7, 0.8), ByDirection(0.6, 0.45), 0.05)
    controls = excitation(same)
    for system in (same, differing):
        identified = found(log_of(system, controls, 1e-4))
        names = {parameter.name for parameter in identified.parameters}
        assert ("coulomb_friction" in names) == system.is_same_both_ways
    backward = truth(identified.system, "coulomb_friction.backward")
    assert backward == pytest.approx(0.45, abs=0.01)


def report(identified: Identification, name: str) -> Any:
    return next(each for each in identified.parameters if each.name.partition(".")[0] == name)


def test_static_friction_is_not_told_by_a_log_that_never_rests() -> None:
    system = System(0.3, 0.2, 2.0, control_limit=5.0, time_step=0.01)
    times = 0.01 * np.arange(1500)
    log = log_of(system, 4.0 * np.sign(np.sin(4.0 * times)), 1e-5)
    identified = found(log, known={"control_limit": 5.0})
    static = report(identified, "static_friction")
    assert not static.identifiable
    assert "rest" in static.why_not
    assert any("break" in advice for advice in identified.advice)
    assert report(identified, "control_gain").identifiable


def test_coulomb_friction_and_damping_are_not_told_apart_at_one_speed() -> None:
    system = System(0.3, 0.2, 2.0, control_limit=5.0, time_step=0.01)
    rng = np.random.default_rng(0)
    controls = 0.2 + 2.0 * 0.46 + np.repeat(rng.uniform(-0.04, 0.04, 40), 10)
    states = rollout(system, np.array([0.0, 0.46]), controls[np.newaxis])[0]
    positions = states[:, 0] + 1e-3 * rng.standard_normal(len(states))
    log = checked_log(0.01, controls, positions)
    identified = found(log, known={"control_limit": 5.0, "bias": 0.0})
    coulomb = report(identified, "coulomb_friction")
    assert not coulomb.identifiable
    assert "damping do the same (condition number" in coulomb.why_not
    assert any("three speeds" in advice for advice in identified.advice)


def test_a_log_of_a_few_moving_steps_tells_nothing() -> None:
    controls = np.concatenate([np.zeros(60), np.full(6, 0.9), np.zeros(60), np.full(6, -0.9)])
    log = log_of(System(), np.concatenate([controls, np.zeros(60)]), 1e-4)
    identified = found(log)
    assert identified.quality.moving_steps < 30
    assert not any(parameter.identifiable for parameter in identified.parameters)
    assert identified.advice


@pytest.mark.parametrize("turn", ["time", "sign"])
def test_a_log_that_runs_backwards_or_has_a_wrong_sign_is_refused(turn: str) -> None:
    controls = pushes(400, seed=3)
    log = log_of(System(), controls, 1e-4)
    wrong = (
        replace(log, controls=-log.controls)
        if turn == "sign"
        else replace(log, controls=log.controls[::-1].copy(), positions=log.positions[::-1].copy())
    )
    for seed in range(3):
        with pytest.raises(UnusableLog, match="no plant of this kind"):
            found(wrong, seed)


def test_a_wrong_sign_that_is_explained_a_little_is_asked_about() -> None:
    system = System(control_limit=8.0)
    log = log_of(system, excitation(system), 1e-4)
    doubt = "is the sign of the control or of the positions reversed?"
    known = {"control_limit": 8.0}
    assert doubt in " ".join(found(replace(log, positions=-log.positions), known=known).warnings)
    assert not is_reversed(log)


def test_a_known_parameter_that_contradicts_the_log_is_refused() -> None:
    log = log_of(System(), pushes(300), 1e-4)
    with pytest.raises(UnusableLog):
        found(log, known={"control_gain": 1000.0})


def test_what_is_known_must_go_together() -> None:
    log = log_of(System(), pushes(300), 1e-4)
    question = Question(known={"static_friction": 0.3, "coulomb_friction": 0.5})
    with pytest.raises(UnusableLog, match="coulomb_friction must not exceed") as refusal:
        question.check(log)
    assert refusal.value.field == "known"


def test_it_ends_when_nobody_wants_it() -> None:
    _, log = recorded(Recording(num_steps=300), 0)
    stop = Stop()
    stop.set(Stopped())
    with pytest.raises(Stopped):
        identify(log, Question(), np.random.default_rng(0), stop)


def test_a_push_at_random_does_not_pass_for_low_static_friction() -> None:
    """Noise sets a mass off below static friction; a filter that knows says so."""
    machine, log = recorded(Recording("ramps", 1000, acceleration_noise=0.1), 4)
    static = report(found(log), "static_friction")
    low, high = static.interval
    assert low <= truth(machine, "static_friction") <= high
    assert found(log).quality.acceleration_noise == pytest.approx(0.1, rel=0.3)


@pytest.mark.parametrize("limits", [0.9, 3.0])
def test_an_excitation_keeps_the_limits_and_tells_all(limits: float) -> None:
    rough = System(0.8, 0.5, 0.1, control_limit=limits)
    controls = excitation(rough)
    assert np.abs(controls).max() <= limits
    states = rollout(System(control_limit=limits), np.zeros(2), controls[np.newaxis])[0]
    positions = states[:, 0] + 1e-4 * np.random.default_rng(0).standard_normal(len(states))
    identified = found(checked_log(0.05, controls, positions), known={"control_limit": limits})
    assert all(parameter.identifiable for parameter in identified.parameters)
    assert not identified.advice
