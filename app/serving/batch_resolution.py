"""From a batch as it came to one with nothing left open: what its problems share, and take."""

from typing import Any

from pydantic import ValidationError

from app.inference.model_store import UnfitModel
from app.serving.admission import Work
from app.serving.batch_parts import MOST_PART_BYTES, size_of_part
from app.serving.batches import Batch
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.serving.service import PlanningService, ResolvedRequest
from app.settings import Settings
from app.wire.batches import PlanBatchRequest
from app.wire.requests import PlanRequest

MOST_PARTS = 8
"""Parts under way at once: more of them only wait for the interpreter."""
SYSTEMS_TRIED = 8
"""Plants that problems bring, where the shared one cannot be planned for."""


def resolve_batch(
    service: PlanningService,
    request: PlanBatchRequest,
    settings: Settings,
    rates: Rates,
    num_cores: int,
    arrived: float | None = None,
    first: int = 0,
) -> Batch:
    """Settle what the problems of a batch share, and refuse what it may not ask.

    The limits of one request hold for each problem; all together have to fit into what may be
    pending at all.

    Args:
        service: plans.
        request: as it came.
        settings: the limits.
        rates: how fast parts of batches are done, and told so.
        num_cores: on which parts are worked on at once.
        arrived: when it did, by `perf_counter`; None for now.
        first: the index of its first problem in a larger batch, of which this is a part.

    Raises:
        UnknownModel, UnfitModel, InvalidField: as `PlanningService.resolve`, of what is shared.
    """
    stand_in, is_shared = _stand_in(service, request, arrived)
    one, count = stand_in.work, len(request.problems)
    for what, each, limit in (
        ("rows through the network", one.rows_left, settings.max_pending_rows),
        ("simulated time steps", one.rollout_steps, settings.max_pending_rollout_steps),
    ):
        if each * count > limit:
            detail = f"{each * count} {what}; at most {limit} are allowed: {limit // each} problems"
            raise InvalidField("/problems", detail)
    kind = f"{one.kind}, in batches"
    size = size_of_part(one, kind, rates)
    parts_at_once = min(MOST_PARTS, num_cores + 1)
    at_once = min(count, parts_at_once * size)
    work = Work(
        one.rows_left * count,
        deadline=one.deadline,
        model=one.model,
        rows_per_step=one.rows_per_step * at_once,
        rollout_steps=one.rollout_steps * count,
        kind=kind,
        answer_bytes=parts_at_once * max(MOST_PART_BYTES, one.answer_bytes),
        is_batch=True,
    )
    return Batch(request, stand_in, work, parts_at_once, is_shared, first, service, rates)


def _stand_in(
    service: PlanningService, request: PlanBatchRequest, arrived: float | None
) -> tuple[ResolvedRequest[PlanRequest], bool]:
    """Resolve a problem like those of a batch, and say whether it is of the shared plant.

    Where that cannot be planned for, the first plants that problems bring are tried.
    """
    shared = {name: getattr(request, name) for name in request.model_fields_set - {"problems"}}
    asked = PlanRequest(initial_state=(0.0, 0.0), target_state=(0.0, 0.0), **shared)
    try:
        return service.resolve(asked, arrived), True
    except (UnfitModel, InvalidField):
        written: list[Any] = list(request.problems)
        brought = [problem.get("system") for problem in written if isinstance(problem, dict)]
        for system in [system for system in brought if system is not None][:SYSTEMS_TRIED]:
            try:
                own = PlanRequest.model_validate({**dict(asked), "system": system})
                return service.resolve(own, arrived), False
            except (UnfitModel, InvalidField, ValidationError):
                continue
        raise
