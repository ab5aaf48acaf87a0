"""Figure 1: all candidates of one plan to a near target, and the one that is selected."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation.cells import percent
from app.evaluation.entrants import PAPER_DIFFUSION
from app.evaluation.question import Question, question_to
from app.evaluation.section import Claim, Picture, Section, Table
from app.evaluation.suite import Answered, Suite
from app.evaluation.suites.sample_budget import TARGET
from app.evaluation.tasks import REST
from app.figures.plan import draw_plan
from app.wire.answers import PlanResponse
from app.wire.requests import PlanRequest

DISTANCES = (0.01, 0.05, 0.1)
"""From the target, within which candidates are counted (m)."""
NEAR = 0.5 * TARGET[0]
"""A candidate that approaches the target ends within half of the way (m)."""
MANY = 0.5
"""Many candidates are more than this share."""


@dataclass(frozen=True)
class SingleTarget(Suite):
    """The paper's picture of one plan and its candidates."""

    name: ClassVar[str] = "single-target"
    purpose: ClassVar[str] = "Figure 1: one plan, 0.2 m from rest to rest, its 512 candidates"

    def questions(self) -> Iterator[Question]:
        k = 32 if self.quick else 512
        fields = {"initial_state": REST, "target_state": TARGET, "include": ["candidates"]}
        yield question_to(
            PAPER_DIFFUSION, PlanRequest, fields, k, self.seed, 0, 0, trajectories=True
        )

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        ((question, answer),) = answered
        assert isinstance(question.request, PlanRequest)
        plan = PlanResponse.model_validate(answer.content)
        errors = np.array(answer.content["candidates"]["terminal_errors"])
        return Section(
            title="One plan and its candidates (Figure 1)",
            introduction=(
                f"From rest to {TARGET[0]:g} m, at rest again, with {PAPER_DIFFUSION.label}: of "
                f"{len(errors)} candidates the one that ends nearest to the target is selected. A "
                f"mass that does not move ends {TARGET[0]:g} m from it."
            ),
            tables=(_shares(errors),),
            pictures=(
                Picture(
                    "single-target",
                    f"A plan of {PAPER_DIFFUSION.label} from rest to {TARGET[0]:g} m, and the "
                    f"{len(errors)} candidates that it is selected from. Inside the grey band a "
                    "push is too weak to start the mass.",
                    draw_plan(question.request, plan),
                ),
            ),
            claims=(_concentration(errors), _threshold_crossing(plan)),
        )


def _within(errors: NDArray[np.float64], distance: float) -> float:
    """Return the share of candidates that end within `distance` of the target."""
    return float(np.mean(errors <= distance))


def _shares(errors: NDArray[np.float64]) -> Table:
    return Table(
        "single-target",
        "Terminal errors of the candidates: the share within a distance of the target, the median "
        "and the least.",
        ("Candidates", *(f"Within {distance:g} m" for distance in DISTANCES), "Median (m)",
         "Best (m)"),
        [
            (
                str(len(errors)),
                *(percent(_within(errors, distance)) for distance in DISTANCES),
                f"{np.median(errors):.3f}",
                f"{errors.min():.4f}",
            )
        ],
    )  # fmt: skip


def _concentration(errors: NDArray[np.float64]) -> Claim:
    shares = ", ".join(
        f"{percent(_within(errors, distance))} within {distance:g} m" for distance in DISTANCES
    )
    return Claim(
        "The proposal concentrates many candidates near trajectories that approach the target.",
        _within(errors, NEAR) > MANY,
        f"Of {len(errors)} candidates {shares}; many are more than {percent(MANY)}, and near is "
        f"within {NEAR:g} m, half of the way.",
    )


def _threshold_crossing(plan: PlanResponse) -> Claim:
    controls = np.array(plan.controls)
    threshold = plan.system.static_friction
    push = int(np.cumprod(controls > threshold).sum())
    weak = np.abs(controls[push:]) <= threshold
    return Claim(
        "The selected control at first exceeds the static-friction threshold to start the mass, "
        "and is then modulated.",
        push > 0 and bool(weak.any()),
        f"The first {push} of {len(controls)} controls exceed {threshold:g} m/s²; {weak.sum()} of "
        f"the others are no stronger than that, and the least of all is {controls.min():.2f} m/s².",
    )
