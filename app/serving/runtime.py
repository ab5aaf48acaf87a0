"""What the routes talk to: requests are settled here, and answered by whoever computes.

`LocalRuntime` computes in this process; app/deploy has one whose work a cluster does.
"""

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import Any, Protocol, TypeAlias, TypeVar

from app.inference.model_card import ModelCard
from app.inference.model_store import ModelStore
from app.inference.verification import ModelRejected
from app.serving.admission import NONE, Admission, Pending, Work
from app.serving.batch_resolution import resolve_batch
from app.serving.batches import Batch, Describe
from app.serving.bodies import Body
from app.serving.control import ControlService
from app.serving.control_session import Compute
from app.serving.control_sessions import ControlSessions
from app.serving.identification import IdentificationService
from app.serving.rates import Rates
from app.serving.refusals import NotReady
from app.serving.service import PlanningService, ResolvedRequest
from app.serving.simulation import SimulationService
from app.serving.turns import Turns
from app.settings import Settings
from app.wire.batches import PlanBatchRequest
from app.wire.model import Asked
from app.wire.requests import MultistepPlanRequest

POLL_SECONDS = 0.02

Gone: TypeAlias = Callable[[], Awaitable[None]]
"""Returns when nobody waits for the answer any more."""
Answered: TypeAlias = tuple[Body, dict[str, float]]
"""An answer's body, and its `timing_ms`."""


log = logging.getLogger(__name__)


def reason(error: Exception) -> str:
    """Return what went wrong, in one line; the error's kind where that says more."""
    text = str(error)
    return text if isinstance(error, ModelRejected) else f"{type(error).__name__}: {text}"


class Resolved(Protocol):
    """A request with nothing left open."""

    @property
    def work(self) -> Work: ...

    @property
    def log_fields(self) -> dict[str, Any]: ...

    @property
    def settled(self) -> Asked: ...


T = TypeVar("T", bound=Resolved)
T_contra = TypeVar("T_contra", bound=Resolved, contravariant=True)


class Answers(Protocol[T_contra]):
    """What works out the answers to such requests."""

    def answer(self, resolved: T_contra, waited_ms: float) -> dict[str, Any]: ...


class Runtime(ABC):
    """The parts behind the routes; `service` exists once it is ready.

    Args:
        settings: of the service.
        rates: how fast work gets done.
        admission: says who may come in.
        steps_of_session: returns what has the steps of one control session computed.
        network_threads: cores that compute.
    """

    def __init__(
        self,
        settings: Settings,
        rates: Rates,
        admission: Admission,
        steps_of_session: Callable[[], Compute],
        network_threads: int,
    ) -> None:
        self.settings = settings
        self.admission = admission
        self.turns = Turns()
        self.network_threads = network_threads
        self.rates = rates
        """How fast work gets done."""
        self._simulation = SimulationService(settings, rates)
        self._control = ControlService(settings, rates)
        self._identification = IdentificationService(settings, rates)
        self._sessions = ControlSessions(settings, steps_of_session)
        self._service: PlanningService | None = None
        self._draining = False
        self._state = "the service is starting"
        self._has_loops = False
        """Whether what is not a plan is compiled, too."""
        self.started = asyncio.Event()
        """Set once the service is ready, or has failed to become so."""
        self.failed = False

    @property
    def service(self) -> PlanningService:
        """The service behind the routes that plan.

        Raises:
            NotReady: it is starting, could not start, or is draining.
        """
        if self._service is None:
            raise NotReady(self._state)
        return self._service

    def batch(self, request: PlanBatchRequest, arrived: float, first: int = 0) -> Batch:
        """Settle what the problems of a batch share; errors as for `service` and `resolve_batch`.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`.
            first: the index of its first problem in a larger batch, of which this is a part.
        """
        service, settings, cores = self.service, self.settings, self.network_threads
        return resolve_batch(service, request, settings, self.rates, cores, arrived, first)

    @property
    def identification(self) -> IdentificationService:
        """The service behind `/identify`; errors as for `service`."""
        self._check_loops()
        return self._identification

    @property
    def simulation(self) -> SimulationService:
        """The service behind `/simulate`; errors as for `service`."""
        self._check_loops()
        return self._simulation

    @property
    def control(self) -> ControlService:
        """The service behind a single step of `/control`; errors as for `service`."""
        self._check_loops()
        return self._control

    @property
    def sessions(self) -> ControlSessions:
        """The sessions of `/control`; errors as for `service`."""
        self._check_loops()
        return self._sessions

    def _check_loops(self) -> None:
        if self._service is None:
            raise NotReady(self._state)
        if not self._has_loops:
            raise NotReady("the service makes plans, and compiles kernels for all else")

    @property
    def open_sessions(self) -> int:
        """How many control sessions there are."""
        return len(self._sessions)

    @property
    def pending(self) -> dict[str, Pending]:
        """What was taken on and is not done, by model; none is left out because it is idle."""
        models = self._service.models.models if self._service else []
        idle = {label: Pending(0, 0) for label in (NONE, *(model.label for model in models))}
        return idle | self.admission.pending

    async def start(self) -> None:
        """Make everything ready, while the probes answer."""
        try:
            await self.load()
        except NotReady:
            log.info("ended before it was ready")
        except Exception as error:
            # Whatever it is: a service that says nothing for ever helps nobody.
            self.failed = True
            known = isinstance(error, ModelRejected)
            self._state = f"the service could not start: {reason(error)}"
            log.error(self._state, exc_info=None if known else error)
        finally:
            self.started.set()

    async def drain(self) -> None:
        """Refuse new work, and return when what was taken on is done."""
        self._draining = True
        self._service = None
        self._state = "the service is draining"
        await self._sessions.drain()
        while len(self.admission):
            await asyncio.sleep(POLL_SECONDS)

    def _put_in_place(self, service: PlanningService) -> None:
        if self._draining:
            raise NotReady(self._state)
        self._service = service

    @abstractmethod
    async def load(self) -> ModelStore[ModelCard]:
        """Put what is new in the model store in the place of the models in use.

        Raises:
            ModelRejected: a model is not what its manifest says; those in use stay.
            NotReady: the service is draining.
        """

    @abstractmethod
    async def answer(
        self, service: Answers[T], resolved: T, *, accepts_gzip: bool, gone: Gone
    ) -> Answered:
        """Have a request answered within its deadline, and while its client waits.

        Args:
            service: that settled it.
            resolved: the request.
            accepts_gzip: whether the body may be compressed.
            gone: returns when nobody waits for it any more.

        Raises:
            Refused: it was not taken on.
            Stopped: DeadlineExceeded, ClientGone or ShuttingDown.
            Exception: what the service raises.
        """

    @abstractmethod
    async def answer_in_segments(
        self,
        resolved: ResolvedRequest[MultistepPlanRequest],
        told: Callable[[bytes], None],
        gone: Gone,
    ) -> Answered:
        """Do as `answer` does, and call `told` with each segment's JSON as soon as it is planned.

        `told` is called from any thread.
        """

    @abstractmethod
    def answer_batch(
        self, batch: Batch, describe: Describe, gone: Gone
    ) -> AsyncGenerator[tuple[range, list[bytes]], None]:
        """Yield parts of a batch with their lines, in whatever order they get done.

        The admission is the caller's; whoever takes the parts sets the pace.

        Args:
            batch: that was admitted.
            describe: says how an error is told.
            gone: returns when nobody waits for it any more.

        Raises:
            Stopped: ClientGone, or whatever else it was stopped with but its deadline.
        """

    @abstractmethod
    def abort(self) -> None:
        """Stop all that was taken on."""

    @abstractmethod
    def close(self) -> None:
        """End, when nothing is under way any more."""
