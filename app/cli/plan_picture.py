"""The picture of `breakaway plan`; matplotlib is loaded only where there is to be one."""

from pathlib import Path

from app.cli import files
from app.failure import Failure
from app.figures.plan import draw_plan
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.requests import MultistepPlanRequest, PlanRequest


def check_picture(request: PlanRequest | MultistepPlanRequest, file: Path) -> None:
    """Find out before the plan is made whether it can be drawn.

    Raises:
        Failure: nobody knows the file's format, or how to draw plans to several targets.
    """
    files.check_picture_format(file)
    if isinstance(request, MultistepPlanRequest):
        raise Failure("--picture: plans to several targets are not drawn, only those to one")


def write_picture(
    request: PlanRequest | MultistepPlanRequest,
    answer: PlanResponse | MultistepPlanResponse,
    file: Path,
) -> None:
    """Draw a plan that `check_picture` has let pass.

    Raises:
        Failure: the file cannot be written.
    """
    assert isinstance(request, PlanRequest)
    assert isinstance(answer, PlanResponse)
    files.write_picture(lambda: draw_plan(request, answer), file)
