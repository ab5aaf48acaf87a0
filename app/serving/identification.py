"""From a log to an answer: check it, weigh what it takes, identify, report."""

from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from app.planning.identification.identify import EVALUATIONS, Question, identify
from app.planning.identification.log import Log
from app.planning.identification.log_checks import UnusableLog, check_control_limit, checked_log
from app.planning.identification.verdict import Identification
from app.serving.admission import Work
from app.serving.json_parts import json_parts
from app.serving.rates import Rates
from app.serving.refusals import InvalidField
from app.serving.seeds import drawn_seed
from app.serving.service import BYTES_PER_NUMBER
from app.settings import Settings
from app.wire.identification import IdentifyRequest, IdentifyResponse

KIND = "identify"
BYTES_PER_SYSTEM = 400
BYTES = 4000
"""Of an answer's text, about: each system, and all else."""


class IdentificationService:
    """All that identifying takes.

    Args:
        settings: the limits.
        rates: told how long it took.
    """

    def __init__(self, settings: Settings, rates: Rates) -> None:
        self._settings = settings
        self._rates = rates

    def resolve(
        self, request: IdentifyRequest, arrived: float | None = None
    ) -> "ResolvedIdentification":
        """Settle what a request leaves open, and refuse a log from which nothing follows.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`; None for now.

        Raises:
            InvalidField: the log is none of one machine in motion, or the deadline is too far.
        """
        most_ms = self._settings.max_deadline_ms
        deadline_ms = request.deadline_ms or most_ms
        if deadline_ms > most_ms:
            detail = f"{deadline_ms} milliseconds; at most {most_ms} are allowed"
            raise InvalidField("/deadline_ms", detail)
        velocities = request.velocities
        try:
            log = checked_log(
                request.time_step,
                np.array(request.controls, dtype=np.float64),
                np.array(request.positions, dtype=np.float64),
                None if velocities is None else np.array(velocities, dtype=np.float64),
            )
            check_control_limit(log, request.known.control_limit)
            request.question.check(log)
        except UnusableLog as error:
            raise InvalidField(f"/{error.field}", str(error)) from None
        rollout_steps, most_steps = EVALUATIONS * log.num_steps, self._settings.max_rollout_steps
        if rollout_steps > most_steps:
            detail = f"a log of {log.num_steps} steps takes {rollout_steps} simulated time steps; "
            raise InvalidField("/controls", f"{detail}at most {most_steps} are allowed")
        work = Work(
            0,
            deadline=(arrived or perf_counter()) + deadline_ms / 1e3,
            model=None,
            rows_per_step=0,
            rollout_steps=rollout_steps,
            kind=KIND,
            answer_bytes=BYTES
            + BYTES_PER_SYSTEM * request.num_systems
            + BYTES_PER_NUMBER * log.num_steps * len(request.include),
        )
        seed = drawn_seed(request.seed)
        predicts = "predictions" in request.include
        return ResolvedIdentification(request, request.question, log, seed, predicts, work)

    def answer(self, resolved: "ResolvedIdentification", waited_ms: float = 0.0) -> dict[str, Any]:
        """Identify, and say what came of it.

        Args:
            resolved: the log and what is asked of it.
            waited_ms: how long the request waited before this call, for the answer's timing.

        Returns:
            The fields of an `IdentifyResponse`, with None for what is absent.

        Raises:
            InvalidField: nothing follows from the log.
            Stopped: the work's stop said so.
        """
        began = perf_counter()
        rng = np.random.default_rng(resolved.seed)
        try:
            found = identify(resolved.log, resolved.question, rng, resolved.work.stop)
        except UnusableLog as error:
            raise InvalidField(f"/{error.field}", str(error)) from None
        seconds = perf_counter() - began
        self._rates.add_steps(KIND, seconds, resolved.work.rollout_steps)
        timing = {"queue": waited_ms, "identify": 1e3 * seconds}
        timing["total"] = sum(timing.values())
        return {
            "seed": resolved.seed,
            "system": asdict(found.system),
            "parameters": [asdict(parameter) for parameter in found.parameters],
            "delay_steps": found.delay_steps,
            "position_lag": found.position_lag,
            "systems": [asdict(system) for system in found.systems],
            "fit": asdict(found.quality),
            "warnings": list(found.warnings),
            "advice": list(found.advice),
            "predictions": _predictions(found) if resolved.predicts else None,
            "timing_ms": {stage: round(ms, 3) for stage, ms in timing.items()},
        }

    def identify(self, resolved: "ResolvedIdentification") -> IdentifyResponse:
        """Answer `POST /identify` with what its client reads; errors as for `answer`."""
        return IdentifyResponse.model_validate_json(b"".join(json_parts(self.answer(resolved))))


@dataclass(frozen=True, slots=True)
class ResolvedIdentification:
    """A request with nothing left open."""

    request: IdentifyRequest
    question: Question
    log: Log
    seed: int
    predicts: bool
    """Whether the answer holds predictions."""
    work: Work

    @property
    def settled(self) -> IdentifyRequest:
        """The request with its seed: whoever answers it answers the same."""
        return self.request.model_copy(update={"seed": self.seed})

    @property
    def log_fields(self) -> dict[str, Any]:
        """What the service's log tells of it."""
        return {"num_steps": self.log.num_steps, "seed": self.seed}


def _predictions(found: Identification) -> dict[str, Any]:
    windows = found.windows
    return {
        "first_samples": (windows.starts + found.delay_steps).tolist(),
        "positions": windows.positions,
    }
