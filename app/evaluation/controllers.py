"""Controllers as a search tuned them for each of the circumstances (see tests/tune_controllers.py).

What the circumstances are is in circumstances.py.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from app.evaluation.circumstances import CIRCUMSTANCES
from app.evaluation.question import Entrant
from app.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY, Look
from app.planning.control import CONTROLLERS, AnyController

FILE = Path(__file__).with_name("tuned_controllers.json")
BY_NAME = {kind().name: kind for kind in CONTROLLERS}


class Tuned(NamedTuple):
    """A controller with settings."""

    controller: AnyController
    steps_left: int | None
    """By when it is asked to arrive, at first; None for as early as it can."""


PD = Entrant("PD", {"tuned": "pd"}, Look(GREY, "x", "--"))
PID = Entrant("PID", {"tuned": "pid"}, Look(BLACK, "+", "--"))
FEEDFORWARD = Entrant(
    "PD + friction feedforward", {"tuned": "pd_feedforward"}, Look(ORANGE, "^", "--")
)
SWITCHING = Entrant("Time-optimal law", {"tuned": "time_optimal_law"}, Look(RED, "P", "--"))
SWITCHING_IDENTIFYING = Entrant(
    "Time-optimal law, identifying",
    {"tuned": "time_optimal_law_identifying"},
    Look(PINK, "X", "--"),
)
RECEDING = Entrant("Receding horizon", {"tuned": "receding_horizon"}, Look(SKY, "o", "-"))
RECEDING_IDENTIFYING = Entrant(
    "Receding horizon, identifying",
    {"tuned": "receding_horizon_identifying"},
    Look(BLUE, "s", "-"),
)
RECEDING_SAVING = Entrant(
    "The same, least energy", {"tuned": "receding_horizon_saving"}, Look(GREEN, "D", "-")
)
LAWS = (PD, PID, FEEDFORWARD, SWITCHING, SWITCHING_IDENTIFYING)
CLOSED = (*LAWS, RECEDING, RECEDING_IDENTIFYING, RECEDING_SAVING)


@cache
def _found() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(FILE.read_text())
    return found


def tuned(entrant: Entrant, circumstances: str) -> Tuned:
    """Return an entrant's controller with what the search found for circumstances, by name."""
    given = CIRCUMSTANCES[circumstances]
    found = _found()[circumstances][entrant.fields["tuned"]]
    options = dict(found["controller"])
    observer = given.observer(identifies=found["identifies"]) if found["observes"] else None
    return Tuned(BY_NAME[options.pop("name")](**options, observer=observer), found["deadline"])
