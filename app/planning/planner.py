"""How a plan comes about: propose, refine, roll out, rank, measure. The one road to a plan."""

from collections.abc import Sequence
from time import perf_counter

import numpy as np

from app.planning.methods.base import LearnedProposal, Method
from app.planning.metrics import (
    control_energy,
    control_smoothness,
    stuck_steps,
    terminal_error,
)
from app.planning.objectives import Objective, best_candidate
from app.planning.plan import MultistepPlan, Plan, RankedCandidates, RefinementEffect
from app.planning.plant.system import FloatArray, System, rollout
from app.planning.problem import Cost, PlanningError, Problem, Timing
from app.planning.reachable.reachability import reachability
from app.planning.refining.refinement import Refined, Refinement, refine
from app.planning.stop import NEVER, Stop


def plan(
    problem: Problem,
    method: Method,
    num_candidates: int,
    rng: np.random.Generator,
    learned: LearnedProposal | None = None,
    refinement: Refinement | None = None,
    objective: Objective = "terminal_error",
    stop: Stop = NEVER,
) -> Plan:
    """Plan from `problem.initial_state` to `problem.target_state` (paper, Sect. 3.5).

    Args:
        problem: start, target, plant and horizon H.
        method: proposes the candidates.
        num_candidates: K.
        rng: every random draw comes from it.
        learned: the learned proposal, for methods that need one.
        refinement: descend from the candidates through the true dynamics before they are ranked;
            None ranks them as they were proposed (the paper).
        objective: what ranks candidates that arrive equally well.
        stop: ends the planning early.

    Raises:
        PlanningError: the method proposed controls that are not finite.
        Stopped: `stop` said so.
    """
    stop.check()
    started = perf_counter()
    proposal = method.propose(problem, num_candidates, rng, learned, stop)
    if not np.all(np.isfinite(proposal.controls)):
        raise PlanningError(f"{method.name} proposed controls that are not finite")
    limit = problem.system.control_limit
    controls = np.clip(proposal.controls, -limit, limit)
    proposed = perf_counter()

    refined = refine(problem, controls, refinement, objective, stop) if refinement else None
    if refined:
        controls = refined.controls
    refined_at = perf_counter()

    states = rollout(problem.system, problem.initial_state, controls)
    errors = terminal_error(states[:, -1], problem.target_state)
    best = best_candidate(problem, controls, states, errors, objective)
    stuck = stuck_steps(states[best], controls[best], problem.target_state[0], problem.system)
    reach = reachability(problem, stop)
    measured = perf_counter()

    return Plan(
        controls=controls[best],
        states=states[best],
        terminal_error=float(errors[best]),
        reachability=reach,
        control_energy=float(control_energy(controls[best])),
        control_smoothness=float(control_smoothness(controls[best])),
        stuck_steps=int(stuck),
        refinement=_effect(refined, best, float(errors[best])) if refined else None,
        cost=plan_cost(method, num_candidates) + Cost(rollouts=refined.rollouts if refined else 0),
        timing=Timing(
            queue=proposal.queue_ms,
            propose=(proposed - started) * 1e3 - proposal.queue_ms,
            refine=(refined_at - proposed) * 1e3,
            rollout=(measured - refined_at) * 1e3,
        ),
        candidates=RankedCandidates(controls, states, errors),
    )


def plan_cost(method: Method, num_candidates: int) -> Cost:
    """Return what `plan` takes without refinement: proposing, then a rollout of each candidate."""
    return method.cost(num_candidates) + Cost(rollouts=num_candidates)


def _effect(refined: Refined, best: int, error: float) -> RefinementEffect:
    return RefinementEffect(
        error_before=float(refined.errors_before.min()),
        error_after=error,
        replaced=bool(refined.replaced[best]),
    )


def plan_multistep(
    initial_state: FloatArray,
    target_states: Sequence[FloatArray],
    system: System,
    horizon: int,
    method: Method,
    num_candidates: int,
    rng: np.random.Generator,
    learned: LearnedProposal | None = None,
    refinement: Refinement | None = None,
    objective: Objective = "terminal_error",
    stop: Stop = NEVER,
) -> MultistepPlan:
    """Plan to each of `target_states` in turn, from the state that the plan before it reached.

    Segmented open-loop planning (paper, Sect. 3.5); arguments and errors as for `plan`.

    Raises:
        ValueError: no targets.
    """
    if not target_states:
        raise ValueError("a multi-step plan needs at least one target")
    segments: list[Plan] = []
    state = initial_state
    for target_state in target_states:
        problem = Problem(state, target_state, system, horizon)
        segments.append(
            plan(problem, method, num_candidates, rng, learned, refinement, objective, stop)
        )
        state = segments[-1].states[-1]
    return MultistepPlan(
        segments=tuple(segments),
        controls=np.concatenate([segment.controls for segment in segments]),
        states=np.concatenate(
            [segments[0].states[:1], *(segment.states[1:] for segment in segments)]
        ),
        final_error=segments[-1].terminal_error,
        mean_end_error=float(np.mean([segment.terminal_error for segment in segments])),
        mean_end_floor=float(np.mean([segment.reachability.floor for segment in segments])),
        stuck_steps=sum(segment.stuck_steps for segment in segments),
        cost=sum((segment.cost for segment in segments), Cost()),
        timing=sum((segment.timing for segment in segments), Timing()),
    )
