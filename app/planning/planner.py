"""How a plan comes about: propose, refine, roll out, rank, measure. The one road to a plan.

Where the plant is uncertain, refinement and ranking are by the risk over all plants it may be.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.denoising import Denoising
from app.planning.methods.base import Method
from app.planning.metrics import control_energy, control_smoothness, stuck_steps, terminal_error
from app.planning.objectives import best_candidate
from app.planning.plan import MultistepPlan, Plan, RankedCandidates, RefinementEffect
from app.planning.plant.rollout import rollout
from app.planning.problem import Cost, PlanningError, Problem, Timing
from app.planning.reachable.outline import outline
from app.planning.reachable.reachability import reachability
from app.planning.recipe import Recipe
from app.planning.refining.gauss_newton import EXACT
from app.planning.refining.refinement import Refined, refine
from app.planning.stop import NEVER, Stop
from app.planning.uncertainty.robustness import judge
from app.planning.uncertainty.search import refine_robustly


def plan(
    problem: Problem, recipe: Recipe[Method], rng: np.random.Generator, stop: Stop = NEVER
) -> Plan:
    """Plan from `problem.initial_state` to `problem.target_state` (paper, Sect. 3.5).

    Args:
        problem: start, target, plant and horizon H.
        recipe: how to plan.
        rng: every random draw comes from it.
        stop: ends the planning early.

    Raises:
        PlanningError: the method proposed controls that are not finite.
        Stopped: `stop` said so.
    """
    stop.check()
    uncertainty = recipe.uncertainty
    started = perf_counter()
    proposal = recipe.method.propose(problem, recipe.num_candidates, rng, stop)
    stop.check()
    if not np.all(np.isfinite(proposal.controls)):
        raise PlanningError(f"{recipe.method.name} proposed controls that are not finite")
    plant = problem.system.plant
    controls = np.clip(proposal.controls, plant.lowest_control, plant.highest_control)
    proposed = perf_counter()

    refined, cost, error_limit = None, recipe.unrefined.cost(), math.inf
    if recipe.refinement:
        refined = refine(problem, controls, recipe.refinement, recipe.objective, stop)
        if uncertainty and uncertainty.is_robust:
            refined = refine_robustly(problem, refined, uncertainty, rng, stop)
        controls, cost = refined.controls, cost + Cost(rollouts=refined.rollouts)
        error_limit = float(refined.errors_before.min()) + EXACT
    refined_at = perf_counter()

    states = rollout(problem.system, problem.initial_state, controls)
    errors = terminal_error(states[:, -1], problem.target_state)
    ranked_by = errors
    if uncertainty and uncertainty.is_robust:
        ranked_by, error_limit = uncertainty.risks(controls, problem.target_state), math.inf
    best = best_candidate(problem, controls, states, ranked_by, recipe.objective, error_limit)
    stuck = stuck_steps(states[best], controls[best], problem.target_state[0], problem.system)
    bound = None
    if recipe.reachability:
        bound = (refined and refined.reachability) or reachability(problem, stop)
    shape = outline(problem, stop) if recipe.outline else None
    steps = proposal.denoising
    denoising = None if steps is None else Denoising.of(problem, steps)
    robustness = None
    if uncertainty:
        robustness = judge(problem, controls[best], float(errors[best]), uncertainty)
    measured = perf_counter()

    return Plan(
        controls=controls[best],
        states=states[best],
        terminal_error=float(errors[best]),
        reachability=bound,
        outline=shape,
        control_energy=float(control_energy(controls[best])),
        control_smoothness=float(control_smoothness(controls[best])),
        stuck_steps=int(stuck),
        refinement=_effect(refined, best, float(errors[best])) if refined else None,
        robustness=robustness,
        cost=cost,
        timing=Timing(
            queue=proposal.queue_ms,
            propose=(proposed - started) * 1e3 - proposal.queue_ms,
            refine=(refined_at - proposed) * 1e3,
            rollout=(measured - refined_at) * 1e3,
        ),
        candidates=RankedCandidates(controls, states, errors),
        denoising=denoising,
    )


def _effect(refined: Refined, best: int, error: float) -> RefinementEffect:
    return RefinementEffect(
        error_before=float(refined.errors_before.min()),
        error_after=error,
        replaced=bool(refined.replaced[best]),
    )


def plan_multistep(
    problem: Problem,
    target_states: Sequence[FloatArray],
    recipe: Recipe[Method],
    rng: np.random.Generator,
    stop: Stop = NEVER,
    told: Callable[[Plan], None] = lambda _: None,
) -> MultistepPlan:
    """Plan to each of `target_states` in turn, from the state that the plan before it reached.

    Segmented open-loop planning (paper, Sect. 3.5); arguments and errors as for `plan`. Where the
    plant is uncertain, each of its plants goes on from the state that it has come to itself.

    Args:
        problem: start, plant and horizon H; its target is not asked for.
        target_states: M of them, (2,) each.
        recipe: how to plan each segment.
        rng: every random draw comes from it.
        stop: ends the planning early.
        told: called with each segment as soon as it is planned.

    Raises:
        ValueError: no targets.
    """
    if not target_states:
        raise ValueError("a multi-step plan needs at least one target")
    segments: list[Plan] = []
    state = problem.initial_state
    for target_state in target_states:
        segment = replace(problem, initial_state=state, target_state=target_state)
        segments.append(plan(segment, recipe, rng, stop))
        told(segments[-1])
        state = segments[-1].states[-1]
        if recipe.uncertainty:
            uncertainty = recipe.uncertainty.after(segments[-1].controls)
            recipe = replace(recipe, uncertainty=uncertainty)
    return MultistepPlan(
        segments=tuple(segments),
        controls=np.concatenate([segment.controls for segment in segments]),
        states=np.concatenate(
            [segments[0].states[:1], *(segment.states[1:] for segment in segments)]
        ),
        final_error=segments[-1].terminal_error,
        mean_end_error=float(np.mean([segment.terminal_error for segment in segments])),
        stuck_steps=sum(segment.stuck_steps for segment in segments),
        cost=sum((segment.cost for segment in segments), Cost()),
        timing=sum((segment.timing for segment in segments), Timing()),
    )
