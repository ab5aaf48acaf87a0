"""From what a request says of the plants that may be the true one to ensembles of them."""

import numpy as np

from app.planning.plant.system import System
from app.planning.problem import as_state
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Implausible
from app.planning.uncertainty.uncertainty import DEFAULT_MOTIONS, NUM_JUDGES, Uncertainty
from app.serving.refusals import InvalidField
from app.wire import uncertainty as wire
from app.wire.requests import State

SHARED = {
    "time_step": ("time_step",),
    "control_limit": ("lowest_control", "highest_control"),
}
"""What a plan for all plants takes to be the same on each, and what of a `Plant` that is."""


def uncertainty_of(
    asked: wire.Uncertainty, system: System, initial_state: State, seed: int
) -> Uncertainty:
    """Return what a plan is to cope with; each of its plants is in the initial state.

    Raises:
        InvalidField: a plant has another time step or other limits, or there is no such plant.
    """
    state = as_state(initial_state)
    if asked.systems is not None:
        _check_shared(asked.systems, system)
        given = Ensemble.of(asked.systems, state)
        return Uncertainty(
            given,
            given,
            risk=asked.measure,
            num_motions=asked.num_motions or DEFAULT_MOTIONS,
            is_robust=asked.robust,
        )
    assert asked.relative is not None
    # Apart from the seed's own draws: a request without uncertainty has the same candidates.
    design_rng, judges_rng = np.random.default_rng(seed).spawn(2)
    try:
        design = asked.relative.draw(system, asked.num_systems, design_rng)
        judges = asked.relative.draw(system, NUM_JUDGES, judges_rng)
        corners = asked.relative.corners(system)
    except Implausible as error:
        raise InvalidField(f"/uncertainty/relative/{error.parameter}", str(error)) from None
    return Uncertainty(
        ensemble=Ensemble.at(design, state),
        judges=Ensemble.at(judges, state),
        corners=Ensemble.at(corners, state),
        risk=asked.measure,
        num_motions=asked.num_motions or DEFAULT_MOTIONS,
        relative=asked.relative,
        is_robust=asked.robust,
    )


def _check_shared(systems: list[System], system: System) -> None:
    for index, other in enumerate(systems):
        for name, parts in SHARED.items():
            if any(getattr(other.plant, part) != getattr(system.plant, part) for part in parts):
                raise InvalidField(
                    f"/uncertainty/systems/{index}/{name}",
                    f"must be that of system, {getattr(system, name)}",
                )
