"""What cannot be a log of one machine in motion is refused, with the field and the reason."""

from typing import Any

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.identification.log import Log
from app.planning.identification.log_checks import UnusableLog, check_control_limit, checked_log
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ControlLimits, System

CONTROLS = np.tile(np.repeat([0.9, -0.4, -0.9, 0.4], 15), 3)
STATES = rollout(System(), np.zeros(2), CONTROLS[np.newaxis])[0]
RNG = np.random.default_rng(0)
POSITIONS = STATES[:, 0] + 1e-4 * RNG.standard_normal(len(STATES))
VELOCITIES = STATES[:, 1] + 1e-3 * RNG.standard_normal(len(STATES))


def changed(values: FloatArray, at: slice | int, to: Any) -> FloatArray:
    copy = values.copy()
    copy[at] = to
    return copy


@pytest.mark.parametrize(
    ("fields", "field", "reason"),
    [
        ({"positions": changed(POSITIONS, 70, np.nan)}, "positions", "first at index 70"),
        ({"controls": np.full(180, 0.9)}, "controls", "the control is 0.9 throughout"),
        ({"positions": np.full(181, 0.2)}, "positions", "nothing moved"),
        (
            {"positions": 1e-4 * np.random.default_rng(1).standard_normal(181)},
            "positions",
            "nothing moved",
        ),
        (
            {"positions": np.concatenate([POSITIONS[:90], POSITIONS[90:] + 1.0])},
            "positions",
            "at index 90, .*two logs in one",
        ),
        ({"positions": changed(POSITIONS, 100, 3.0)}, "positions", "jumps"),
        ({"positions": 1e3 * POSITIONS}, "positions", "another unit than m"),
        ({"positions": 1e-8 * POSITIONS}, "positions", "another unit than m"),
        ({"time_step": 50.0}, "time_step", "are times in ms"),
        ({"time_step": 1e-6}, "time_step", "in another unit"),
        (
            {
                "controls": np.linspace(0.0, 0.9, 30),
                "positions": np.concatenate([np.zeros(28), [2e-4, 5e-4]]),
            },
            "positions",
            "too short: the machine moves in the last 2 of 29 steps only",
        ),
        ({"velocities": 1e3 * VELOCITIES}, "velocities", "1e[+]03 times"),
        ({"velocities": VELOCITIES[::-1].copy()}, "velocities", "same axis"),
        ({"velocities": VELOCITIES[:100]}, "velocities", "100 velocities to 181 positions"),
        ({"positions": POSITIONS[:100]}, "positions", "100 positions to 180 controls"),
        ({"controls": CONTROLS[:20], "positions": POSITIONS[:21]}, "controls", "too few"),
        ({"controls": 1e-9 * CONTROLS}, "controls", "smaller unit"),
    ],
)
def test_it_is_refused_in_words(fields: dict[str, Any], field: str, reason: str) -> None:
    whole = {"time_step": 0.05, "controls": CONTROLS, "positions": POSITIONS} | fields
    with pytest.raises(UnusableLog, match=reason) as refusal:
        checked_log(**whole)
    assert refusal.value.field == field


def test_the_last_control_may_show_in_nothing() -> None:
    log = checked_log(0.05, CONTROLS, POSITIONS[:-1], VELOCITIES[:-1])
    assert log.num_steps == len(CONTROLS) - 1
    assert len(log.positions) == len(CONTROLS)


def test_a_delayed_log_pairs_controls_with_what_they_do() -> None:
    log = checked_log(0.05, CONTROLS, POSITIONS)
    late = log.delayed(3)
    np.testing.assert_array_equal(late.controls, CONTROLS[:-3])
    np.testing.assert_array_equal(late.positions, POSITIONS[3:])
    same_samples = log.delayed(1, 3)
    np.testing.assert_array_equal(same_samples.controls, CONTROLS[2:-1])
    np.testing.assert_array_equal(same_samples.positions, late.positions)


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_the_noise_is_seen_beside_the_motion(noise: float) -> None:
    positions = STATES[:, 0] + noise * np.random.default_rng(2).standard_normal(len(STATES))
    log = Log(0.05, CONTROLS, positions)
    assert log.position_noise == pytest.approx(noise, rel=0.4)


def test_the_resolution_of_an_encoder_is_seen() -> None:
    counted = Log(0.05, CONTROLS, 2.5e-4 * np.round(POSITIONS / 2.5e-4))
    assert counted.resolution == pytest.approx(2.5e-4)
    assert counted.position_noise >= 2.5e-4 / np.sqrt(12.0)
    assert Log(0.05, CONTROLS, POSITIONS).resolution == 0.0


@pytest.mark.parametrize("limit", [0.5, ControlLimits(-0.5, 0.9), ControlLimits(-0.9, 0.8)])
def test_controls_that_lie_beyond_the_limit_are_refused(limit: float | ControlLimits) -> None:
    with pytest.raises(UnusableLog, match="the log holds a control of") as refusal:
        check_control_limit(checked_log(0.05, CONTROLS, POSITIONS), limit)
    assert refusal.value.field == "known/control_limit"


@pytest.mark.parametrize("limit", [None, 0.9, 0.89, ControlLimits(-0.9, 2.0)])
def test_controls_within_the_limit_are_not(limit: float | ControlLimits | None) -> None:
    check_control_limit(checked_log(0.05, CONTROLS, POSITIONS), limit)
