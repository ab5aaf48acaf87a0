"""The robust refinement: successive halving from many motions to a plan of small risk.

The descent of one of them is in descent.py.
"""

from dataclasses import replace

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.problem import Problem
from app.planning.refining.gauss_newton import terminal_error_of
from app.planning.refining.refinement import Refined
from app.planning.stop import NEVER, Stop
from app.planning.uncertainty.descent import descend_risk
from app.planning.uncertainty.motions import draw_motions
from app.planning.uncertainty.rests import without_idle_pushes
from app.planning.uncertainty.uncertainty import FINISHED, NUM_FEW, STAGES, Uncertainty


def refine_robustly(
    problem: Problem,
    refined: Refined,
    uncertainty: Uncertainty,
    rng: np.random.Generator,
    stop: Stop = NEVER,
) -> Refined:
    """Put a plan of small risk in the place of the candidate of the greatest, if it is better.

    Candidates and drawn motions are ranked by their mean squared error on a few plants; the best
    descend it for a few steps, the best of these for some more. What is left descends on all
    plants, extreme ones too, and the best of it the risk itself, and it does not push a mass that
    rests. No candidate is lost to a worse
    one, so the best risk is never above that of any candidate.

    Args:
        problem: start, target, plant and horizon H.
        refined: candidates (K, H), which arrive on the plant of the problem as near as they can.
        uncertainty: the plants, the risk, and how many motions to draw.
        rng: draws them.
        stop: ends the search early.

    Raises:
        Stopped: `stop` said so.
    """
    plan, rollouts = _search(problem, refined.controls, uncertainty, rng, stop)
    stop.check()
    plan = without_idle_pushes(plan, uncertainty.refined_on, problem.system.plant)
    rollouts += 2 * len(uncertainty.refined_on)
    risks = uncertainty.risks(refined.controls, problem.target_state)
    (risk,) = uncertainty.risks(plan[np.newaxis], problem.target_state)
    rollouts += refined.rollouts + (len(risks) + 1) * len(uncertainty.ensemble)
    worst = int(np.argmax(risks))
    if risk >= risks[worst]:
        return replace(refined, rollouts=rollouts)
    controls, errors = refined.controls.copy(), refined.errors.copy()
    replaced = refined.replaced.copy()
    controls[worst], replaced[worst] = plan, True
    errors[worst] = terminal_error_of(plan, problem.task)
    return replace(refined, controls=controls, errors=errors, replaced=replaced, rollouts=rollouts)


def _search(
    problem: Problem,
    candidates: FloatArray,
    uncertainty: Uncertainty,
    rng: np.random.Generator,
    stop: Stop,
) -> tuple[FloatArray, int]:
    """Return the plan (H,) that the halving ends with, and the rollouts; stopped, any plan."""
    target, ensemble = problem.target_state, uncertainty.ensemble
    few, refined_on = ensemble.spread(NUM_FEW), uncertainty.refined_on
    on_few, everywhere = few.scenarios(target), refined_on.scenarios(target)
    counted = uncertainty.risk.num_counted(len(refined_on))
    motions = draw_motions(rng, uncertainty.num_motions, problem.horizon, problem.system.plant)
    plans = np.concatenate([candidates, motions])
    starts = uncertainty.num_starts(len(candidates))
    losses = np.mean(few.errors(plans, target) ** 2, axis=-1)
    rollouts = len(plans) * len(few)
    for stage in STAGES:
        plans = plans[np.argsort(losses, kind="stable")[: stage.count(starts)]]
        losses = np.empty(len(plans))
        for i, plan in enumerate(plans):
            losses[i], spent = descend_risk(
                plan, on_few, float(len(few)), True, stage.iterations, stop.flag
            )
            rollouts += spent
    plans = plans[np.argsort(losses, kind="stable")[: FINISHED.count(starts)]]
    for plan in plans:
        _, spent = descend_risk(plan, everywhere, counted, True, FINISHED.iterations, stop.flag)
        rollouts += spent
    best = plans[np.argmin(uncertainty.risks(plans, target))]
    _, spent = descend_risk(best, everywhere, counted, False, FINISHED.iterations, stop.flag)
    return best, rollouts + spent + len(plans) * len(ensemble)
