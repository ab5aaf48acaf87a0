"""From plans to the fields of an answer, with numpy's arrays as they are: `json_parts` writes them.

None is what is absent. The fields are those of the models in app/wire/answers.py.
"""

from collections.abc import Container
from dataclasses import asdict
from typing import Any

from app.planning.denoising import Denoising
from app.planning.plan import MultistepPlan, Plan, RefinementEffect
from app.planning.problem import Cost, Timing
from app.planning.reachable.outline import Outline
from app.planning.reachable.reachability import Reachability
from app.planning.uncertainty.robustness import Robustness
from app.wire.answers import ReachabilityReport
from app.wire.requests import Inclusion


def segment_fields(result: Plan, include: Container[Inclusion]) -> dict[str, Any]:
    """Return the fields of a `Segment`."""
    candidates = result.candidates
    with_states = "states" in include
    return {
        "controls": result.controls,
        "states": result.states if with_states else None,
        "terminal_error": result.terminal_error,
        "gap": result.gap,
        "reachability": result.reachability and _reachability_fields(result.reachability),
        "refinement": result.refinement and _refinement_fields(result.refinement),
        "robustness": result.robustness and _robustness_fields(result.robustness, include),
        "control_energy": result.control_energy,
        "control_smoothness": result.control_smoothness,
        "stuck_steps": result.stuck_steps,
        "diversity": candidates.diversity,
        "cost": _cost_fields(result.cost),
        "timing_ms": timing_fields(result.timing),
        "candidates": {
            "controls": candidates.controls,
            "terminal_errors": candidates.terminal_errors,
            "states": candidates.states if with_states else None,
        }
        if "candidates" in include
        else None,
        "candidate_errors": candidates.terminal_errors if "candidate_errors" in include else None,
        "reachable_set": result.outline and _outline_fields(result.outline),
        "denoising": result.denoising and _denoising_fields(result.denoising, include),
    }


def _refinement_fields(effect: RefinementEffect) -> dict[str, Any]:
    """Return the fields of a `RefinementReport`."""
    return {
        "error_before": effect.error_before,
        "error_after": effect.error_after,
        "replaced": effect.replaced,
    }


def _reachability_fields(reachability: Reachability) -> dict[str, Any]:
    """Return the fields of a `ReachabilityReport`; the domain knows more."""
    return {name: getattr(reachability, name) for name in ReachabilityReport.model_fields}


def _robustness_fields(robustness: Robustness, include: Container[Inclusion]) -> dict[str, Any]:
    """Return the fields of a `RobustnessReport`, with the risk as it was asked for."""
    risk = robustness.risk
    fields = asdict(robustness)
    fields["risk"] = {"cvar": risk.level} if risk.name == "cvar" else risk.name
    told = robustness.told
    fields["told"] = told and {**told.spread._asdict(), "left_out": told.left_out or None}
    if "ensemble" not in include:
        fields |= {"errors": None, "fan": None}
    return fields


def _outline_fields(outline: Outline) -> dict[str, Any]:
    """Return the fields of a `ReachableSet`."""
    return {"polygons": list(outline.polygons), "at_rest": outline.at_rest}


def _denoising_fields(denoising: Denoising, include: Container[Inclusion]) -> dict[str, Any]:
    """Return the fields of a `DenoisingReport`."""
    return {
        "controls": denoising.controls,
        "terminal_errors": denoising.terminal_errors,
        "states": denoising.states if "states" in include else None,
    }


def multistep_fields(result: MultistepPlan, include: Container[Inclusion]) -> dict[str, Any]:
    """Return the fields of a `MultistepPlanResponse` that say what was planned."""
    return {
        "segments": [segment_fields(part, include) for part in result.segments],
        "controls": result.controls,
        "states": result.states if "states" in include else None,
        "final_error": result.final_error,
        "mean_end_error": result.mean_end_error,
        "mean_end_floor": result.mean_end_floor,
        "stuck_steps": result.stuck_steps,
        "cost": _cost_fields(result.cost),
    }


def _cost_fields(cost: Cost) -> dict[str, int]:
    """Return the fields of a `CostReport`."""
    return {"network_evaluations": cost.network_evaluations, "rollouts": cost.rollouts}


def timing_fields(timing: Timing) -> dict[str, float]:
    """Return the fields of a `TimingReport`, to the microsecond: what lies below is noise."""
    fields = {
        "queue": timing.queue,
        "propose": timing.propose,
        "refine": timing.refine,
        "rollout": timing.rollout,
        "total": timing.total,
    }
    return {stage: round(ms, 3) for stage, ms in fields.items()}
