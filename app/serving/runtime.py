"""What lives as long as the service: models, engine and workers; their start and their end."""

import asyncio
import logging
import threading
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from time import perf_counter
from typing import TypeVar

import anyio
import anyio.to_thread

from app.compilation.parts import Part, are_kept, compile_missing
from app.inference.device import choose_device
from app.inference.engine import Engine, Tick, Watch
from app.inference.model import Model
from app.inference.model_store import ModelStore
from app.inference.networks import KINDS
from app.inference.shares import Share
from app.inference.verification import ModelRejected
from app.memory import set_aside_what_stays
from app.planning.warm_up import warm_up, warm_up_loops
from app.serving.admission import NONE, Admission, Pending
from app.serving.batch_resolution import resolve_batch
from app.serving.batches import Batch
from app.serving.control import ControlService
from app.serving.control_sessions import ControlSessions
from app.serving.identification import IdentificationService
from app.serving.kernels import LOOPS, NETWORK, PLANNING, available_cores
from app.serving.rates import Rates
from app.serving.refusals import NotReady, ShuttingDown
from app.serving.service import PlanningService
from app.serving.simulation import SimulationService
from app.serving.workers import Workers
from app.settings import Settings
from app.terminal import progress_line
from app.wire.batches import PlanBatchRequest

POLL_SECONDS = 0.02

T = TypeVar("T")

log = logging.getLogger(__name__)


def reason(error: Exception) -> str:
    """Return what went wrong, in one line; the error's kind where that says more."""
    text = str(error)
    return text if isinstance(error, ModelRejected) else f"{type(error).__name__}: {text}"


class Runtime:
    """The parts behind the routes; `service` exists once it is ready.

    Args:
        settings: of the service.
        watch: told of every batch of the engine, in the engine's thread.
        share: says whose rows go through the network next.
    """

    def __init__(self, settings: Settings, watch: Watch, share: Share) -> None:
        self.settings = settings
        self.network_threads = available_cores()
        self._rates = Rates()

        def watch_tick(tick: Tick) -> None:
            self._rates.add_tick(tick)
            watch(tick)

        self._device = choose_device()
        self._engine = Engine(self.network_threads, watch_tick, share)
        # As if the network always had work: nobody is promised a core that it may need.
        compiled_at_once = max(1, self.network_threads - 1)
        self.admission = Admission(settings, self._rates, compiled_at_once)
        self.workers = Workers(self.admission, self._engine.row_threads)
        self._simulation = SimulationService(settings, self._rates)
        self._control = ControlService(settings, self._rates)
        self._sessions = ControlSessions(settings, self.network_threads)
        self._loading = asyncio.Lock()
        self._service: PlanningService | None = None
        self._identification = IdentificationService(settings, self._rates)
        self._draining = False
        self._state = "the service is starting"
        self._has_loops = False
        """Whether what is not a plan is compiled, too."""
        self._stop = threading.Event()
        self.started = asyncio.Event()
        """Set once the service is ready, or has failed to become so."""
        self.failed = False

    @property
    def service(self) -> PlanningService:
        """The service behind the routes.

        Raises:
            NotReady: it is starting, could not start, or is draining.
        """
        if self._service is None:
            raise NotReady(self._state)
        return self._service

    def batch(self, request: PlanBatchRequest, arrived: float) -> Batch:
        """Settle what the problems of a batch share; errors as for `service` and `resolve_batch`.

        Args:
            request: as it came.
            arrived: when it did, by `perf_counter`.
        """
        cores = self.network_threads
        return resolve_batch(self.service, request, self.settings, self._rates, cores, arrived)

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

    def check_ready(self) -> None:
        """Return if plans can be made; errors as for `service`."""
        if self._service is None:
            raise NotReady(self._state)

    def _check_loops(self) -> None:
        self.check_ready()
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
        """Load everything in a thread, while the probes answer; then compile what may wait."""
        try:
            await self.load()
        except NotReady:
            log.info("ended before it was ready")
            return
        except Exception as error:
            # Whatever it is: a service that says nothing for ever helps nobody.
            self.failed = True
            known = isinstance(error, ModelRejected)
            self._state = f"the service could not start: {reason(error)}"
            log.error(self._state, exc_info=None if known else error)
            return
        finally:
            self.started.set()
        await self._compile_loops()
        await self._compile_network()

    async def load(self) -> None:
        """Load what is new in the store beside the models in use, then put all in their place.

        Plans under way keep the models that they began with.

        Raises:
            ModelRejected: a model is not what its manifest says; those in use stay.
            NotReady: the service is draining.
        """
        async with self._loading:
            started = perf_counter()
            serving = self._service.models.models if self._service else None
            models = await self._in_thread(lambda: self._load(serving))
            self._put_in_place(models)
            labels = ", ".join(model.label for model in models.models) or "no models"
            log.info("ready after %.1f s with %s", perf_counter() - started, labels)

    def _load(self, serving: Sequence[Model] | None) -> ModelStore:
        """Compile what planning needs, and load the models; blocks.

        Raises:
            ModelRejected: a model is not what its manifest says.
            NotReady: the service is draining.
        """
        with progress_line() as show:

            def tell(text: str) -> None:
                show(text)
                if self._service is None and not self._draining:
                    self._state = f"the service is starting: {text}"

            compile_missing(PLANNING, self.network_threads, tell, self._stop)
            if self._stop.is_set():
                raise NotReady(self._state)
            tell("loading models")
            warm_up()
            if are_kept(LOOPS):
                self._warm_up_loops()
            kinds = KINDS if are_kept(NETWORK) else KINDS[-1:]
            return self._engine.load(self.settings.model_store, self._device, kinds, serving)

    def _put_in_place(self, models: ModelStore) -> None:
        if self._draining:
            raise NotReady(self._state)
        self._service = PlanningService(self.settings, models, self._engine, self._rates)
        set_aside_what_stays()

    async def _compile_loops(self) -> None:
        """Compile what plans do without, while they are served."""
        if self._has_loops:
            return
        log.info("plans are served; closed loops and machines from logs when they are compiled")
        try:
            await self._in_thread(partial(self._compile, LOOPS))
            if not self._draining:
                await self._in_thread(self._warm_up_loops)
                log.info("closed loops and machines from logs are served, too")
        except Exception as error:
            log.warning("no closed loops, and no machines from logs: %s", reason(error))

    async def _compile_network(self) -> None:
        """Put compiled networks in the place of TorchScript, which served until they were here."""
        if self._device.type != "cpu" or not self.service.models.models or are_kept(NETWORK):
            return
        log.info("TorchScript runs the models until their kernels are compiled")
        try:
            await self._in_thread(partial(self._compile, NETWORK))
            async with self._loading:
                store = self.settings.model_store
                models = await self._in_thread(lambda: self._engine.load(store, self._device))
                self._put_in_place(models)
        except NotReady:
            pass
        except Exception as error:
            log.warning("TorchScript goes on running the models: %s", reason(error))
        else:
            log.info("the models run compiled")

    def _warm_up_loops(self) -> None:
        warm_up_loops()
        self._has_loops = True

    def _compile(self, parts: Iterable[Part]) -> None:
        compile_missing(parts, self.network_threads, lambda _: None, self._stop)

    async def _in_thread(self, function: Callable[[], T]) -> T:
        """Return `function()`, called in a thread that nobody waits for once the service ends."""
        return await anyio.to_thread.run_sync(function, abandon_on_cancel=True)

    async def drain(self) -> None:
        """Refuse new work, and return when what was taken on is done."""
        self._draining = True
        self._stop.set()
        self._service = None
        self._state = "the service is draining"
        await self._sessions.drain()
        while len(self.admission):
            await asyncio.sleep(POLL_SECONDS)

    def abort(self) -> None:
        """Stop all that was taken on."""
        for work in self.admission.works:
            work.stop.set(ShuttingDown("the service was told to end at once"))

    def close(self) -> None:
        """End the engine, when nothing is under way any more."""
        self._sessions.close()
        self._engine.close()
