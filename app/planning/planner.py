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
from app.planning.methods.base import Method, propose_many
from app.planning.metrics import control_energy, control_smoothness, stuck_steps, terminal_error
from app.planning.objectives import best_candidate
from app.planning.plan import MultistepPlan, Plan, RankedCandidates, RefinementEffect
from app.planning.plant.rollout import rollout_many
from app.planning.problem import Cost, PlanningError, Problem, Timing
from app.planning.reachable.outline import outline
from app.planning.reachable.reachability import Reachability, reachability
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
    return plan_many([problem], recipe, [rng], stop)[0]


def plan_many(
    problems: Sequence[Problem],
    recipe: Recipe[Method],
    rngs: Sequence[np.random.Generator],
    stop: Stop = NEVER,
) -> list[Plan]:
    """Plan for N problems of one plant and horizon; each has the plan that it has alone.

    What Python takes for a plan beside its kernels it takes once for all of them.

    Args:
        problems: N of them, at least one.
        recipe: how to plan for each.
        rngs: every random draw for a problem comes from its own.
        stop: ends the planning early.

    Returns:
        The plans in the same order, each with the mean of what they took in each stage.

    Raises:
        PlanningError: the method proposed controls that are not finite, for one of them.
        Stopped: `stop` said so.
        ValueError: the problems differ in plant or horizon.
    """
    system = problems[0].system
    if any((p.system, p.horizon) != (system, problems[0].horizon) for p in problems[1:]):
        raise ValueError("plans are made together for problems of one plant and horizon")
    stop.check()
    started = perf_counter()
    proposals = propose_many(recipe.method, problems, recipe.num_candidates, rngs, stop)
    stop.check()
    controls = np.stack([proposal.controls for proposal in proposals])  # (N, K, H)
    if not np.all(np.isfinite(controls)):
        raise PlanningError(f"{recipe.method.name} proposed controls that are not finite")
    controls = np.clip(controls, system.plant.lowest_control, system.plant.highest_control)
    proposed = perf_counter()

    refined = [
        _refined(problem, own, recipe, rng, stop, are_robust=proposal.told is not None)
        for problem, own, proposal, rng in zip(problems, controls, proposals, rngs, strict=True)
    ]
    if recipe.refinement:
        controls = np.stack([result.controls for result in refined if result])
    refined_at = perf_counter()

    starts = np.array([problem.initial_state for problem in problems])
    targets = np.array([problem.target_state for problem in problems])
    states = rollout_many(system.plant, starts, controls)  # (N, K, H+1, 2)
    errors = terminal_error(states[:, :, -1], targets[:, np.newaxis])
    each = np.arange(len(problems))
    best = np.array(
        [
            _best(problem, recipe, controls[i], states[i], errors[i], refined[i])
            for i, problem in enumerate(problems)
        ]
    )
    chosen, passed = controls[each, best], states[each, best]
    energies, smoothnesses = control_energy(chosen), control_smoothness(chosen)
    stuck = stuck_steps(passed, chosen, targets[:, :1], system)
    bounds = [
        _bound(problem, recipe, result, stop)
        for problem, result in zip(problems, refined, strict=True)
    ]
    shapes = [outline(problem, stop) if recipe.outline else None for problem in problems]
    denoising = [
        None if proposal.denoising is None else Denoising.of(problem, proposal.denoising)
        for problem, proposal in zip(problems, proposals, strict=True)
    ]
    robustness = [
        judge(problem, own, float(error), recipe.uncertainty, proposal.told)
        if recipe.uncertainty
        else None
        for problem, own, error, proposal in zip(
            problems, chosen, errors[each, best], proposals, strict=True
        )
    ]
    measured = perf_counter()

    count, unrefined = len(problems), recipe.unrefined.cost()
    waited_ms = min(proposal.queue_ms for proposal in proposals)
    timing = Timing(
        queue=waited_ms / count,
        propose=((proposed - started) * 1e3 - waited_ms) / count,
        refine=(refined_at - proposed) * 1e3 / count,
        rollout=(measured - refined_at) * 1e3 / count,
    )
    return [
        Plan(
            controls=chosen[i],
            states=passed[i],
            terminal_error=float(errors[i, best[i]]),
            reachability=bounds[i],
            outline=shapes[i],
            control_energy=float(energies[i]),
            control_smoothness=float(smoothnesses[i]),
            stuck_steps=int(stuck[i]),
            refinement=_effect(result, best[i], float(errors[i, best[i]])) if result else None,
            robustness=robustness[i],
            cost=unrefined + Cost(rollouts=result.rollouts) if result else unrefined,
            timing=timing,
            candidates=RankedCandidates(controls[i], states[i], errors[i]),
            denoising=denoising[i],
        )
        for i, result in enumerate(refined)
    ]


def _refined(
    problem: Problem,
    controls: FloatArray,
    recipe: Recipe[Method],
    rng: np.random.Generator,
    stop: Stop,
    *,
    are_robust: bool,
) -> Refined | None:
    """Return candidates (K, H) after refinement, where the recipe has one.

    Those that `are_robust` already do not descend on the problem's own plant.
    """
    if recipe.refinement is None:
        return None
    if are_robust:
        refined = Refined.of(problem, controls)
    else:
        refined = refine(problem, controls, recipe.refinement, recipe.objective, stop)
    if recipe.uncertainty and recipe.uncertainty.is_robust:
        return refine_robustly(problem, refined, recipe.uncertainty, rng, stop)
    return refined


def _best(
    problem: Problem,
    recipe: Recipe[Method],
    controls: FloatArray,
    states: FloatArray,
    errors: FloatArray,
    refined: Refined | None,
) -> int:
    """Return the index of the best of K candidates: by their risks where there are any."""
    error_limit = math.inf
    if recipe.uncertainty and recipe.uncertainty.is_robust:
        errors = recipe.uncertainty.risks(controls, problem.target_state)
    elif refined:
        error_limit = float(refined.errors_before.min()) + EXACT
    return best_candidate(problem, controls, states, errors, recipe.objective, error_limit)


def _bound(
    problem: Problem, recipe: Recipe[Method], refined: Refined | None, stop: Stop
) -> Reachability | None:
    """Return how near any plan could come, where that is asked for."""
    if not recipe.reachability:
        return None
    return (refined and refined.reachability) or reachability(problem, stop)


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
