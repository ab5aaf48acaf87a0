"""The service as an application of Ray Serve: `serve run app.deploy.ray:application`.

Its settings are the BREAKAWAY_* variables; what the cluster has of it are arguments, like
`serve run app.deploy.ray:application max_replicas=8`.
"""

import asyncio
from typing import Any, cast

from pydantic import BaseModel, ConfigDict, PositiveInt
from ray import serve
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.deploy.cluster import ClusterRuntime, Handle
from app.deploy.replica import Replica
from app.logs import set_up_logging
from app.main import create_app
from app.settings import Settings
from app.settings_options import read_settings

LOGGING = {"enable_access_log": False}
"""The service logs its requests itself; Serve would do so twice more, at ingress and replica."""
MOST_AT_ONCE = 100_000
"""Calls of Ray's that may be under way; who may come in is for our own admission to say."""


class ClusterOptions(BaseModel):
    """What a cluster has of the service."""

    model_config = ConfigDict(extra="forbid")

    ingresses: PositiveInt = 1
    """Processes that speak HTTP; about one for each 300 requests a second."""
    min_replicas: PositiveInt = 1
    max_replicas: PositiveInt = 2
    cores: PositiveInt = 1
    """Of a replica."""


@serve.ingress()
class Ingress:
    """Speaks HTTP: the very application of a single machine, with replicas behind it.

    Args:
        settings: of the service.
        replicas: a handle of their deployment.
        cores: of each of them.
    """

    def __init__(self, settings: Settings, replicas: Handle, cores: int) -> None:
        set_up_logging(settings.log_level, settings.log_format)
        self._settings = settings
        self._replicas = replicas
        self._cores = cores

    def __serve_build_asgi_app__(self) -> ASGIApp:
        return WithinServe(
            create_app(
                self._settings,
                lambda settings, _: ClusterRuntime(settings, self._replicas, self._cores),
            )
        )


class WithinServe:
    """Hands the lifespan's state to each request, as a server does, and leaves ids to Serve.

    Serve's proxy puts X-Request-ID into what it hands on, and into what comes back. It cancels the
    requests of clients that hang up: the service is told as a server tells it, and ends the work.

    Args:
        app: the service.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._state: dict[str, Any] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            self._state = scope["state"]
            await self._app(scope, receive, send)
            return

        async def send_without_id(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = [pair for pair in message["headers"] if pair[0] != b"x-request-id"]
                message = {**message, "headers": headers}
            await send(message)

        left = asyncio.Event()

        async def receive_until_left() -> Message:
            waiting = [asyncio.ensure_future(one) for one in (receive(), left.wait())]
            try:
                await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
                message: asyncio.Future[Any] = waiting[0]
                return message.result() if message.done() else {"type": "http.disconnect"}
            finally:
                for one in waiting:
                    one.cancel()

        scope = {**scope, "state": dict(self._state)}
        if scope["type"] == "websocket":
            await self._app(scope, receive, send_without_id)
            return
        answering = asyncio.ensure_future(self._app(scope, receive_until_left, send_without_id))
        try:
            await asyncio.shield(answering)
        except asyncio.CancelledError:
            left.set()
            await answering
            raise


def application(options: ClusterOptions) -> serve.Application:
    """Return the service for a cluster.

    Raises:
        Failure: a BREAKAWAY_* variable is no setting's, or its value is not valid.
    """
    settings = read_settings(Settings.model_fields)
    ingress: Any = serve.deployment(
        name="ingress",
        num_replicas=options.ingresses,
        max_ongoing_requests=MOST_AT_ONCE,
        ray_actor_options={"num_cpus": 0},
        logging_config=LOGGING,
        graceful_shutdown_timeout_s=settings.max_deadline_ms / 1e3,
    )(Ingress)
    bound = ingress.bind(settings, replicas_of(settings, options), options.cores)
    return cast(serve.Application, bound)


def replicas_of(settings: Settings, options: ClusterOptions) -> serve.Application:
    """Return the replicas alone, which an ingress has behind it."""
    replicas: Any = serve.deployment(
        name="replica",
        max_ongoing_requests=MOST_AT_ONCE,
        ray_actor_options={"num_cpus": options.cores},
        logging_config=LOGGING,
        health_check_period_s=1,
        health_check_timeout_s=10,
        graceful_shutdown_timeout_s=settings.max_deadline_ms / 1e3,
        request_router_config={
            "request_router_class": "app.deploy.router.LeastWork",
            "request_routing_stats_period_s": 1,
        },
        autoscaling_config={
            "min_replicas": options.min_replicas,
            "max_replicas": options.max_replicas,
            "metrics_interval_s": 1,
            "look_back_period_s": 5,
            "upscale_delay_s": 5,
            "downscale_delay_s": 300,
            "policy": {"policy_function": "app.deploy.router:by_outstanding_rows"},
        },
    )(Replica)
    return cast(serve.Application, replicas.bind(settings, options.cores))
