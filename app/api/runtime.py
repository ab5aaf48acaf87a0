"""What lives as long as the service: its models, its engine and its workers, and their start."""

import logging
from time import perf_counter

import anyio.to_thread
import loky
import torch

from app.api.errors import NotReady
from app.api.service import PlanningService
from app.api.workers import Workers
from app.inference.engine import Engine
from app.inference.model_store import ModelRejected
from app.planning.warm_up import warm_up
from app.settings import Settings

log = logging.getLogger(__name__)


def available_cores() -> int:
    """Return the cores that this process may use: the cgroup's quota, not the host's count."""
    return int(loky.cpu_count())


def choose_device() -> torch.device:
    """Return the GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def start_service(settings: Settings, engine: Engine) -> PlanningService:
    """Compile the kernels, verify, load and warm up the models; blocks.

    Raises:
        ModelRejected: a model of the store is not what its manifest says.
    """
    warm_up()
    models = engine.load(settings.model_store, choose_device())
    return PlanningService(settings, models, engine)


class Runtime:
    """The parts behind the routes; `service` exists once it is ready."""

    def __init__(self, settings: Settings) -> None:
        cores = available_cores()
        self.settings = settings
        self.network_threads = cores
        self.workers = Workers(settings.max_pending, cores)
        self._engine = Engine(cores)
        self._service: PlanningService | None = None
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

    async def start(self) -> None:
        """Load everything in a thread; the probes answer meanwhile."""
        started = perf_counter()
        try:
            self._service = await anyio.to_thread.run_sync(
                start_service, self.settings, self._engine
            )
        except ModelRejected as error:
            self._state = f"the service could not start: {error}"
            log.error(self._state)
        else:
            models = ", ".join(model.label for model in self._service.models.models) or "no models"
            log.info("ready after %.1f s with %s", perf_counter() - started, models)

    def stop(self) -> None:
        """Refuse new work, finish what was begun."""
        self._service = None
        self._state = "the service is draining"
        self._engine.close()
