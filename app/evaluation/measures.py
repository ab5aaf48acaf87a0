"""From an answer to a row of numbers."""

import numpy as np

from app.evaluation.answer_log import Answer

OF_A_PLAN = ("terminal_error", "gap", "control_energy", "control_smoothness")
OF_A_SEQUENCE = ("final_error", "mean_end_error", "mean_end_floor")


def measures(answer: Answer) -> dict[str, float]:
    """Return the measures of a plan, or of a sequence of plans.

    Errors, gaps and floors are in m (or rad, as the plant is), energy and smoothness in squared
    units of control, times in ms; `compute_ms` is the service's own time for all plans of the
    answer, `latency_ms` what the client waited.
    """
    content = answer.content
    row: dict[str, float] = {"seed": content["seed"]}
    if "segments" in content:
        row |= {name: content[name] for name in OF_A_SEQUENCE}
        plans = content["segments"]
        row["control_energy"] = sum(part["control_energy"] for part in plans)
        row["mean_end_gap"] = content["mean_end_error"] - content["mean_end_floor"]
    else:
        plans = [content]
        row |= {name: content[name] for name in OF_A_PLAN}
        row["floor"] = content["reachability"]["floor"]
        row["reachable"] = content["reachability"]["reachable"]
    # Answers of earlier services do not have it.
    row["diversity"] = float(np.mean([part.get("diversity", np.nan) for part in plans]))
    return row | {
        "stuck_steps": content["stuck_steps"],
        "network_evaluations": content["cost"]["network_evaluations"],
        "rollouts": content["cost"]["rollouts"],
        "compute_ms": answer.compute_ms,
        "latency_ms": answer.latency_ms,
    }
