"""What lives as long as the service: models, engine and workers; their start and their end."""

import asyncio
import logging
from collections.abc import Sequence
from time import perf_counter

import anyio
import anyio.to_thread
import loky

from app.inference.device import choose_device
from app.inference.engine import Engine, Tick, Watch
from app.inference.model_store import Model, ModelStore
from app.inference.shares import Share
from app.inference.verification import ModelRejected
from app.memory import set_aside_what_stays
from app.planning.warm_up import warm_up
from app.serving.admission import Admission, Pending
from app.serving.rates import Rates
from app.serving.refusals import NotReady, ShuttingDown
from app.serving.service import PlanningService
from app.serving.workers import Workers
from app.settings import Settings

POLL_SECONDS = 0.02

log = logging.getLogger(__name__)


def available_cores() -> int:
    """Return the cores that this process may use: the cgroup's quota, not the host's count."""
    return int(loky.cpu_count())


def load_models(
    settings: Settings, engine: Engine, serving: Sequence[Model] | None = None
) -> ModelStore:
    """Compile the kernels, verify, load and warm up the models; blocks.

    Args:
        settings: where the store is.
        engine: will run them.
        serving: models that are kept if the store still holds the very same; None at first.

    Raises:
        ModelRejected: a model of the store is not what its manifest says.
    """
    warm_up()
    return engine.load(settings.model_store, choose_device(), serving)


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

        self._engine = Engine(self.network_threads, watch_tick, share)
        # As if the network always had work: nobody is promised a core that it may need.
        compiled_at_once = max(1, self.network_threads - 1)
        self.admission = Admission(settings, self._rates, compiled_at_once)
        self.workers = Workers(self.admission, self._engine.row_threads)
        self._loading = asyncio.Lock()
        self._service: PlanningService | None = None
        self._draining = False
        self._state = "the service is starting"

    @property
    def service(self) -> PlanningService:
        """The service behind the routes.

        Raises:
            NotReady: it is starting, could not start, or is draining.
        """
        if self._service is None:
            raise NotReady(self._state)
        return self._service

    @property
    def pending(self) -> dict[str, Pending]:
        """What was taken on and is not done, by model."""
        return self.admission.pending

    async def start(self) -> None:
        """Load everything in a thread; the probes answer meanwhile."""
        try:
            await self.load()
        except ModelRejected as error:
            self._state = f"the service could not start: {error}"
            log.error(self._state)
        except NotReady:
            log.info("ended before it was ready")

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
            models = await anyio.to_thread.run_sync(
                load_models, self.settings, self._engine, serving
            )
            if self._draining:
                raise NotReady(self._state)
            self._service = PlanningService(self.settings, models, self._engine, self._rates)
            set_aside_what_stays()
            labels = ", ".join(model.label for model in models.models) or "no models"
            log.info("ready after %.1f s with %s", perf_counter() - started, labels)

    async def drain(self) -> None:
        """Refuse new work, and return when what was taken on is done."""
        self._draining = True
        self._service = None
        self._state = "the service is draining"
        while len(self.admission):
            await asyncio.sleep(POLL_SECONDS)

    def abort(self) -> None:
        """Stop all that was taken on."""
        for work in self.admission.works:
            work.stop.set(ShuttingDown("the service was told to end at once"))

    def close(self) -> None:
        """End the engine, when nothing is under way any more."""
        self._engine.close()
