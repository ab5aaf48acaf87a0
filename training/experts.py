"""The plans that a model of every machine learns from, each with its task."""

import math
from dataclasses import replace
from typing import Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from app.planning.arrays import FloatArray
from app.planning.methods.dataset_prior import DatasetPrior
from app.planning.objectives import CONTROL_ENERGY, TERMINAL_ERROR
from app.planning.planner import plan
from app.planning.plant.rollout import rollout
from app.planning.plant.spread import Spread
from app.planning.plant.system import ByDirection, System
from app.planning.prior import ControlPrior
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement, refine
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.uncertainty import DEFAULT_MOTIONS, MAX_MOTIONS, Uncertainty
from training.machines import RandomMachines
from training.section import Section, Share
from training.tasks import Tasks
from training.uncertainty import MOST_DAMPING, RandomSpreads

NUM_DESIGN = 32
"""Plants that a robust plan is made for."""

Kind: TypeAlias = Literal["rollout", "exact", "least_energy", "margin", "robust"]
KIND_NAMES: dict[Kind, str] = {
    "rollout": "rollouts of random controls",
    "exact": "exact plans",
    "least_energy": "exact plans of least energy",
    "margin": "exact plans of least energy with a margin of static friction",
    "robust": "robust plans for machines that are not known exactly",
}


class Experts(Section):
    """What the plans are, by shares that add up to 1."""

    rollout: Share
    """Draws of the prior, for the targets that they happen to reach (the paper's data)."""
    exact: Share
    """Plans that end as near to the target as the machine can."""
    least_energy: Share
    """The same with the least energy that descent finds."""
    margin: Share
    """The same, planned with more static friction than there is and brought to the target after."""
    static_margin: Annotated[float, Field(ge=0)]
    """How much more, as a share."""
    robust: Share = 0.0
    """Plans of the least mean error on the plants that a machine may be, by successive halving."""
    spreads: RandomSpreads = RandomSpreads()
    """How far the machines of robust plans may be off; all others are known exactly."""
    num_motions: Annotated[int, Field(ge=1, le=MAX_MOTIONS)] = DEFAULT_MOTIONS
    """From which the search for a robust plan starts."""
    num_candidates: Annotated[int, Field(ge=1)]
    """Draws of the prior from which each plan descends; the best is kept."""

    @model_validator(mode="after")
    def _shares_add_up(self) -> "Experts":
        if not math.isclose(sum(self.shares.values()), 1.0):
            raise ValueError(
                "the shares of rollout, exact, least_energy, margin and robust must add up to 1"
            )
        return self

    @property
    def shares(self) -> dict[Kind, float]:
        """Of each kind."""
        return {kind: getattr(self, kind) for kind in KIND_NAMES}

    def __str__(self) -> str:
        """Write the kinds and their shares."""
        return ", ".join(
            f"{share:.0%} {KIND_NAMES[kind]}" for kind, share in self.shares.items() if share
        )


class Plans(NamedTuple):
    """N plans and their tasks."""

    controls: FloatArray
    """(N, H)."""
    tasks: Tasks

    def with_mirror_images(self) -> "Plans":
        """Return them, and after them what a mirror makes of each: 2 N."""
        return Plans(
            np.concatenate([self.controls, -self.controls]),
            self.tasks.followed_by(self.tasks.mirrored()),
        )


def draw_plans(
    machines: RandomMachines,
    experts: Experts,
    prior: ControlPrior,
    num_plans: int,
    horizon: int,
    rng: np.random.Generator,
) -> Plans:
    """Draw machines and tasks, and make a plan for each of N; the same for the same `rng`."""
    tasks = machines.sample(num_plans, horizon, rng)
    kinds = rng.choice(list(experts.shares), num_plans, p=list(experts.shares.values()))
    proposals = DatasetPrior(prior=prior)
    if experts.robust:
        spreads = experts.spreads.sample(num_plans, rng)
        tasks = tasks.with_spreads(np.where(kinds[:, np.newaxis] == "robust", spreads, 0.0))
    controls, targets = np.empty((num_plans, horizon)), tasks.states[:, 2:].copy()
    for i, kind in enumerate(kinds):
        problem = tasks.problem(i, horizon)
        if kind == "robust":
            controls[i] = _robust_plan(problem, tasks.spreads[i], experts, proposals, rng)
        else:
            controls[i] = _plan(kind, problem, experts, proposals, rng)
        if kind == "rollout":
            targets[i] = rollout(problem.system, problem.initial_state, controls[i : i + 1])[0, -1]
    return Plans(controls, tasks.with_targets(targets))


def _plan(
    kind: Kind,
    problem: Problem,
    experts: Experts,
    proposals: DatasetPrior,
    rng: np.random.Generator,
) -> FloatArray:
    """Return a plan (H,) of some kind for a problem."""
    if kind == "rollout":
        return np.asarray(proposals.propose(problem, 1, rng).controls[0])
    objective = TERMINAL_ERROR if kind == "exact" else CONTROL_ENERGY
    recipe = Recipe(proposals, experts.num_candidates, Refinement(), objective)
    if kind != "margin":
        return plan(problem, recipe, rng).controls
    harder = replace(problem, system=_stickier(problem.system, experts.static_margin))
    controls = plan(harder, recipe, rng).controls
    return np.asarray(refine(problem, controls[np.newaxis], Refinement()).controls[0])


def _robust_plan(
    problem: Problem,
    spread: FloatArray,
    experts: Experts,
    proposals: DatasetPrior,
    rng: np.random.Generator,
) -> FloatArray:
    """Return a plan (H,) of small mean error on the plants within a spread (4,)."""
    shares = Spread(*spread.tolist())
    plant = problem.system.plant
    most = MOST_DAMPING / (max(plant.damping_forward, plant.damping_backward) * plant.time_step)
    relative = Relative(
        **shares._replace(viscous_damping=min(shares.viscous_damping, most - 1.0))._asdict()
    )
    state = problem.initial_state
    ensemble = Ensemble.at(relative.draw(problem.system, NUM_DESIGN, rng), state)
    corners = Ensemble.at(relative.corners(problem.system), state)
    uncertainty = Uncertainty(ensemble, ensemble, corners, num_motions=experts.num_motions)
    recipe = Recipe(
        proposals, experts.num_candidates, Refinement(repair=False), uncertainty=uncertainty
    )
    return plan(problem, recipe, rng).controls


def _stickier(system: System, margin: float) -> System:
    """Return the system with that share more static friction."""
    static = system.static_friction
    assert isinstance(static, ByDirection)
    more = ByDirection((1 + margin) * static.forward, (1 + margin) * static.backward)
    return replace(system, static_friction=more)
