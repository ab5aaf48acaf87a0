"""Figure 1: all candidates of one plan to a near target, and the one that is selected."""

import numpy as np
import pandas as pd

from app.evaluation import grid
from app.evaluation.case import Case
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.statistics import percent
from app.evaluation.suite import Claim, Parts, Picture, Size, Suite
from app.evaluation.suites.sample_budget import TARGET
from app.evaluation.tasks import one_task
from app.figures.plan import draw_plan
from app.wire.answers import PlanResponse
from app.wire.requests import PlanRequest

ERROR = "terminal_error"
DISTANCES = (0.01, 0.05, 0.1)
"""From the target, within which candidates are counted (m)."""
NEAR = 0.5 * TARGET[0]
"""A candidate that approaches the target ends within half of the way (m)."""
MANY = 0.5
"""Many candidates are more than this share."""


class SingleTarget(Suite):
    """Figure 1: one plan, 0.2 m from rest to rest, its 512 candidates."""

    name = "single-target"
    title = "One plan and its candidates (Figure 1)"
    draw_tasks = staticmethod(one_task(target_state=TARGET, include=["candidates"]))
    FULL = Size(budgets=(512,), entrants=(PAPER_DIFFUSION,))
    QUICK = Size(budgets=(32,), entrants=(PAPER_DIFFUSION,))
    trajectories = True

    def report(self, data: pd.DataFrame) -> Parts:
        (question,), (answer,) = self.questions(), data.answer
        assert isinstance(question.request, PlanRequest)
        plan = PlanResponse.model_validate(answer.content)
        errors = answer.content["candidates"]["terminal_errors"]
        frame = pd.DataFrame({"entrant": PAPER_DIFFUSION.label, ERROR: errors})
        candidates = Case(frame, PAPER_DIFFUSION, {})
        yield (
            f"From rest to {TARGET[0]:g} m, at rest again, with {PAPER_DIFFUSION.label}: of "
            f"{len(errors)} candidates the one that ends nearest to the target is selected. A "
            f"mass that does not move ends {TARGET[0]:g} m from it."
        )
        yield Picture(
            f"A plan of {PAPER_DIFFUSION.label} from rest to {TARGET[0]:g} m, and the "
            f"{len(errors)} candidates that it is selected from. Inside the grey band a push is "
            "too weak to start the mass.",
            draw_plan(question.request, plan),
        )
        yield grid.table(
            "Terminal errors of the candidates: the share within a distance of the target, the "
            "median and the least.",
            [candidates],
            (
                grid.Column("Candidates", lambda case: str(len(case.rows))),
                *(grid.within(f"Within {limit:g} m", ERROR, limit) for limit in DISTANCES),
                grid.median("Median (m)", ERROR, 3),
                grid.Column("Best (m)", lambda case: f"{case.values(ERROR).min():.4f}"),
            ),
        )
        yield _concentration(candidates)
        yield _threshold_crossing(plan)


def _concentration(candidates: Case) -> Claim:
    shares = ", ".join(
        f"{percent(candidates.share_within(ERROR, distance))} within {distance:g} m"
        for distance in DISTANCES
    )
    return Claim(
        "The proposal concentrates many candidates near trajectories that approach the target.",
        candidates.share_within(ERROR, NEAR) > MANY,
        f"Of {len(candidates.rows)} candidates {shares}; many are more than {percent(MANY)}, and "
        f"near is within {NEAR:g} m, half of the way.",
    )


def _threshold_crossing(plan: PlanResponse) -> Claim:
    controls = np.array(plan.controls)
    threshold = plan.system.plant.static_forward
    push = int(np.cumprod(controls > threshold).sum())
    weak = np.abs(controls[push:]) <= threshold
    return Claim(
        "The selected control at first exceeds the static-friction threshold to start the mass, "
        "and is then modulated.",
        push > 0 and bool(weak.any()),
        f"The first {push} of {len(controls)} controls exceed {threshold:g} m/s²; {weak.sum()} of "
        f"the others are no stronger than that, and the least of all is {controls.min():.2f} m/s².",
    )
