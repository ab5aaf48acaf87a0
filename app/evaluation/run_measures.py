"""What a run of a closed loop is worth in the evaluation, and the columns that show it."""

from typing import Any

import numpy as np

from app.evaluation import grid
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case
from app.evaluation.circumstances import STEPS
from app.evaluation.question import Question
from app.planning.arrays import FloatArray
from app.planning.metrics import POSITION_TOLERANCE
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON
from app.wire.simulation import SimulateRequest

MIDWAY = DEFAULT_HORIZON
KEPT = (MIDWAY, STEPS)
"""Steps whose states are kept of each answer."""


def measures_of(question: Question, request: SimulateRequest, answer: Answer) -> dict[str, Any]:
    """Return the measures of the one run that an answer has, its states and its time a step."""
    assert request.target_state
    (run,) = answer.content["runs"]
    states = np.array(run["states"])
    midway, final = states[list(question.kept_steps).index(MIDWAY)], states[-1]
    measured = measures(
        midway,
        final,
        request.target_state[0],
        (request.system or System()).time_step * run.get("settling_step", STEPS),
        hunting=run["hunting"],
        energy=run["control_energy"],
    )
    return {**measured, "us": 1e3 * answer.compute_ms / STEPS, "states": states}


def measures(
    midway: FloatArray,
    final: FloatArray,
    target: float,
    settling_s: float,
    *,
    hunting: bool,
    energy: float,
) -> dict[str, float]:
    """Return the measures of a run.

    Args:
        midway: (2,), the state after as many steps as a plan has, m and m/s.
        final: (2,), the last state.
        target: m.
        settling_s: when it settles, s.
        hunting: whether it hunts.
        energy: of its controls.
    """
    row: dict[str, float] = {
        "settling_s": settling_s,
        "hunting": float(hunting),
        "energy": energy,
    }
    for when, (position, velocity) in (("midway", midway), ("final", final)):
        error = abs(float(position) - target)
        is_slow = abs(float(velocity)) < POSITION_TOLERANCE
        row[f"{when}_mm"] = 1e3 * error
        row[f"{when}_inside"] = float(error < POSITION_TOLERANCE and is_slow)
    return row


def columns(*compared: grid.Column[Case]) -> tuple[grid.Column[Case], ...]:
    """Return the columns of a table of runs; those that compare follow the share inside."""
    return (
        grid.mean("Error", "midway_mm", 2),
        grid.share("Inside", "midway_inside", 1),
        *compared,
        grid.mean("Error at the end", "final_mm", 3),
        grid.share("Inside at the end", "final_inside", 1),
        grid.median("Settling (s)", "settling_s", 2),
        grid.share("Hunting", "hunting", 1),
        grid.mean("Energy", "energy", 1),
        grid.Column("Step (µs)", _microseconds),
    )


def _microseconds(case: Case) -> str:
    """Write what a step takes the service; open loops have none."""
    us = float(np.median(case.values("us")))
    return "" if np.isnan(us) else f"{us:.1f}"
