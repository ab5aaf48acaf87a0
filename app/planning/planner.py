"""How a plan comes about: propose, roll out, rank, measure. The one road to a plan."""

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
from app.planning.problem import (
    Cost,
    MultistepPlan,
    Plan,
    PlanningError,
    Problem,
    RankedCandidates,
    Timing,
)
from app.planning.system import FloatArray, System, rollout


def plan(
    problem: Problem,
    method: Method,
    num_candidates: int,
    rng: np.random.Generator,
    learned: LearnedProposal | None = None,
) -> Plan:
    """Plan from `problem.initial_state` to `problem.target_state` (paper, Sect. 3.5).

    Args:
        problem: start, target, plant and horizon H.
        method: proposes the candidates.
        num_candidates: K.
        rng: every random draw comes from it.
        learned: the learned proposal, for methods that need one.

    Raises:
        PlanningError: the method proposed controls that are not finite.
    """
    started = perf_counter()
    proposal = method.propose(problem, num_candidates, rng, learned)
    if not np.all(np.isfinite(proposal.controls)):
        raise PlanningError(f"{method.name} proposed controls that are not finite")
    limit = problem.system.control_limit
    controls = np.clip(proposal.controls, -limit, limit)
    proposed = perf_counter()

    states = rollout(problem.system, problem.initial_state, controls)
    errors = terminal_error(states[:, -1], problem.target_state)
    best = int(np.argmin(errors))
    stuck = stuck_steps(states[best], controls[best], problem.target_state[0], problem.system)
    rolled_out = perf_counter()

    return Plan(
        controls=controls[best],
        states=states[best],
        terminal_error=float(errors[best]),
        control_energy=float(control_energy(controls[best])),
        control_smoothness=float(control_smoothness(controls[best])),
        stuck_steps=int(stuck),
        cost=plan_cost(method, num_candidates),
        timing=Timing(
            queue=proposal.queue_ms,
            propose=(proposed - started) * 1e3 - proposal.queue_ms,
            rollout=(rolled_out - proposed) * 1e3,
        ),
        candidates=RankedCandidates(controls, states, errors),
    )


def plan_cost(method: Method, num_candidates: int) -> Cost:
    """Return what `plan` will take: the proposal, then one rollout of each candidate."""
    return method.cost(num_candidates) + Cost(rollouts=num_candidates)


def plan_multistep(
    initial_state: FloatArray,
    target_states: Sequence[FloatArray],
    system: System,
    horizon: int,
    method: Method,
    num_candidates: int,
    rng: np.random.Generator,
    learned: LearnedProposal | None = None,
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
        segments.append(plan(problem, method, num_candidates, rng, learned))
        state = segments[-1].states[-1]
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
