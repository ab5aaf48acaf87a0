"""What the service counts and times, for Prometheus.

The engine, the service and the middleware call the methods; `GET /metrics` shows the result.
"""

from collections.abc import Mapping

from prometheus_client import (
    CONTENT_TYPE_PLAIN_0_0_4,
    CollectorRegistry,
    Counter,
    Gauge,
    GCCollector,
    Histogram,
    PlatformCollector,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)

from app.serving.admission import NONE, Pending

STEP_SECONDS = (0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1)
SESSION_SECONDS = (1, 10, 60, 600, 3600, 36_000)
REQUEST_SECONDS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60)
TICK_SECONDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1)
TICK_ROWS = tuple(2**power for power in range(11))

WEBSOCKET = "WEBSOCKET"
"""In the place of an HTTP method."""
SWITCHING_PROTOCOLS = 101

# A second series for each first one, which nobody asks for.
disable_created_metrics()  # type: ignore[no-untyped-call]


class Metrics:
    """The metrics of one service; every label `model` is "name/version" or "none".

    Labels never come from a client: each value that they take is kept for ever.
    """

    def __init__(self) -> None:
        self._registry = registry = CollectorRegistry()
        ProcessCollector(registry=registry)
        PlatformCollector(registry=registry)
        GCCollector(registry=registry)
        self._requests = Counter(
            "breakaway_requests_total",
            "Requests answered; status 499: the client hung up before.",
            ["route", "http_method", "status", "method", "model"],
            registry=registry,
        )
        self._request_seconds = Histogram(
            "breakaway_request_duration_seconds",
            "From the end of a request's head to the end of its answer.",
            ["route", "method", "model"],
            buckets=REQUEST_SECONDS,
            registry=registry,
        )
        self._queue_seconds = Histogram(
            "breakaway_queue_seconds",
            "How long a plan waited before it was worked on.",
            ["model"],
            buckets=REQUEST_SECONDS,
            registry=registry,
        )
        self._tick_seconds = Histogram(
            "breakaway_tick_seconds",
            "One evaluation of a model's network.",
            ["model"],
            buckets=TICK_SECONDS,
            registry=registry,
        )
        self._tick_rows = Histogram(
            "breakaway_tick_rows",
            "Rows in one evaluation of a model's network.",
            ["model"],
            buckets=TICK_ROWS,
            registry=registry,
        )
        self._pending_requests = Gauge(
            "breakaway_pending_requests",
            "Plans at work or waiting.",
            ["model"],
            registry=registry,
        )
        self._rows_waiting = Gauge(
            "breakaway_rows_waiting",
            "Rows that pending plans still need from a model's network.",
            ["model"],
            registry=registry,
        )
        self._answer_bytes = Gauge(
            "breakaway_answer_bytes",
            "Bytes of answers that are to be made or sent.",
            ["model"],
            registry=registry,
        )
        self._rejected = Counter(
            "breakaway_rejected_total",
            "Plans that were asked for and not made, by reason.",
            ["reason", "model"],
            registry=registry,
        )

        self._sessions = Gauge(
            "breakaway_control_sessions", "Control sessions that are open.", registry=registry
        )
        self._session_seconds = Histogram(
            "breakaway_control_session_duration_seconds",
            "From the beginning of a control session to its end.",
            ["controller"],
            buckets=SESSION_SECONDS,
            registry=registry,
        )
        self._step_seconds = Histogram(
            "breakaway_control_step_seconds",
            "From a measurement's arrival until its control is there, in a session.",
            ["controller"],
            buckets=STEP_SECONDS,
            registry=registry,
        )
        self._late_steps = Counter(
            "breakaway_control_late_steps_total",
            "Controls of sessions that came later than their deadline.",
            ["controller"],
            registry=registry,
        )

    def observe_request(
        self,
        *,
        route: str,
        http_method: str,
        status: int,
        seconds: float,
        method: str = NONE,
        model: str = NONE,
    ) -> None:
        """Count a request that is over, and how long it took (s)."""
        self._requests.labels(route, http_method, str(status), method, model).inc()
        self._request_seconds.labels(route, method, model).observe(seconds)

    def observe_session(
        self, *, route: str, status: int, seconds: float, controller: str = NONE
    ) -> None:
        """Count a control session that is over, or was refused, and how long it took (s)."""
        self._requests.labels(route, WEBSOCKET, str(status), controller, NONE).inc()
        if status == SWITCHING_PROTOCOLS:
            self._session_seconds.labels(controller).observe(seconds)

    def observe_step(self, controller: str, seconds: float, *, is_late: bool) -> None:
        """Note how long a step of a session took (s)."""
        self._step_seconds.labels(controller).observe(seconds)
        if is_late:
            self._late_steps.labels(controller).inc()

    def observe_queue(self, model: str, seconds: float) -> None:
        """Note how long a plan waited before it was worked on (s)."""
        self._queue_seconds.labels(model).observe(seconds)

    def observe_tick(self, model: str, rows: int, seconds: float) -> None:
        """Note one evaluation of a network: its rows and its time (s)."""
        self._tick_rows.labels(model).observe(rows)
        self._tick_seconds.labels(model).observe(seconds)

    def rejected(self, reason: str, model: str = NONE) -> None:
        """Count a plan that was asked for and not made."""
        self._rejected.labels(reason, model).inc()

    def render(self, pending: Mapping[str, Pending], open_sessions: int) -> tuple[bytes, str]:
        """Return all metrics in Prometheus' text format, and its content type.

        Args:
            pending: what is pending now, by model.
            open_sessions: how many control sessions there are.
        """
        self._sessions.set(open_sessions)
        for gauge in (self._pending_requests, self._rows_waiting, self._answer_bytes):
            gauge.clear()
        for model, (requests, rows, answer_bytes) in pending.items():
            self._pending_requests.labels(model).set(requests)
            self._rows_waiting.labels(model).set(rows)
            self._answer_bytes.labels(model).set(answer_bytes)
        return generate_latest(self._registry), CONTENT_TYPE_PLAIN_0_0_4
