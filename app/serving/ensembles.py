"""From what a request says of the plants that may be the true one to ensembles of them."""

import numpy as np

from app.planning.arrays import FloatArray
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
"""What plants that stand for each other have in common, and what of a `Plant` that is."""


def ensemble_of(asked: wire.Ensemble, system: System, state: FloatArray, seed: int) -> Ensemble:
    """Return the plants that plans are made for, each in a `state` (2,).

    Raises:
        InvalidField: a plant has another time step or other limits, or there is no such plant.
    """
    if asked.systems is not None:
        for index, other in enumerate(asked.systems):
            check_shared(f"/uncertainty/systems/{index}", other, system)
        return Ensemble.of(asked.systems, state)
    assert asked.relative is not None
    try:
        plants = asked.relative.draw(system, asked.num_systems, _rngs(seed)[0])
    except Implausible as error:
        raise InvalidField(f"/uncertainty/relative/{error.parameter}", str(error)) from None
    return Ensemble.at(plants, state)


def uncertainty_of(
    asked: wire.Uncertainty, system: System, initial_state: State, seed: int
) -> Uncertainty:
    """Return what a plan is to cope with; each of its plants is in the initial state.

    Raises:
        InvalidField: as for `ensemble_of`.
    """
    state = as_state(initial_state)
    ensemble = ensemble_of(asked, system, state, seed)
    judges, corners = ensemble, None
    if asked.relative is not None:
        judges = Ensemble.at(asked.relative.draw(system, NUM_JUDGES, _rngs(seed)[1]), state)
        corners = Ensemble.at(asked.relative.corners(system), state)
    return Uncertainty(
        ensemble=ensemble,
        judges=judges,
        corners=corners,
        risk=asked.measure,
        num_motions=asked.num_motions or DEFAULT_MOTIONS,
        relative=asked.relative,
        is_robust=asked.robust,
    )


def _rngs(seed: int) -> list[np.random.Generator]:
    """Return what draws the plants that plans are made for, and those that judge them.

    Apart from the seed's own draws: a request without uncertainty has the same candidates.
    """
    return np.random.default_rng(seed).spawn(2)


def check_shared(pointer: str, other: System, system: System) -> None:
    """Check that another plant can stand for `system`.

    Raises:
        InvalidField: it has another time step, or other limits.
    """
    for name, parts in SHARED.items():
        if any(getattr(other.plant, part) != getattr(system.plant, part) for part in parts):
            detail = f"must be that of system, {getattr(system, name)}"
            raise InvalidField(f"{pointer}/{name}", detail)
