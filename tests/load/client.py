"""Asks one question at a time, and notes whether the answer is its own."""

import json
from collections.abc import Iterator
from time import perf_counter
from types import TracebackType
from typing import Any, NamedTuple, Self

import httpx
from prometheus_client.parser import text_string_to_metric_families

from tests.load.connections import KEPT_SECONDS, Connections, NoAnswer
from tests.load.scenario import Body

PROBLEM = "application/problem+json"
ROUTES = ("/plan", "/plan_multistep")


class Answer(NamedTuple):
    """What came back; status 0 where nothing did."""

    route: str
    status: int
    latency: float
    """s, from before the request was sent until its answer was read."""
    is_own: bool
    """Whether it names the request's id, and a plan its seed."""
    content_type: str
    body: Any
    """The JSON, or what else there is to say."""


class Metrics:
    """A reading of `GET /metrics`."""

    def __init__(self, text: str) -> None:
        self._samples = [
            (sample.name, sample.labels, sample.value)
            for family in text_string_to_metric_families(text)
            for sample in family.samples
        ]

    def total(self, name: str, **labels: str) -> float:
        """Return the sum over all of that name that have these labels.

        Raises:
            KeyError: nothing has that name.
        """
        if not any(found == name for found, _, _ in self._samples):
            raise KeyError(name)
        return sum(value for _, value in self._matching(name, labels))

    def by(self, name: str, label: str) -> dict[str, float]:
        """Return the sums by one label's values."""
        sums: dict[str, float] = {}
        for labels, value in self._matching(name, {}):
            sums[labels[label]] = sums.get(labels[label], 0.0) + value
        return sums

    @property
    def answered(self) -> dict[tuple[str, int], int]:
        """How many requests for plans were answered, by route and status."""
        counts: dict[tuple[str, int], int] = {}
        for labels, value in self._matching("breakaway_requests_total", {"http_method": "POST"}):
            if labels["route"] in ROUTES:
                key = labels["route"], int(labels["status"])
                counts[key] = counts.get(key, 0) + int(value)
        return counts

    @property
    def memory_mb(self) -> float:
        """Resident memory of the server, MB."""
        return self.total("process_resident_memory_bytes") / 1e6

    @property
    def cpu_seconds(self) -> float:
        return self.total("process_cpu_seconds_total")

    def _matching(
        self, name: str, labels: dict[str, str]
    ) -> Iterator[tuple[dict[str, str], float]]:
        for found, own, value in self._samples:
            if found == name and labels.items() <= own.items():
                yield own, value


class ServiceClient:
    """A client of a running service, for any number of requests at once.

    Args:
        url: where it is.
    """

    def __init__(self, url: str) -> None:
        self.connections = Connections(url)
        self.http = httpx.AsyncClient(
            base_url=url, timeout=60, limits=httpx.Limits(keepalive_expiry=KEPT_SECONDS)
        )
        """For all but plans."""
        self._asked = 0

    async def ask(self, route: str, body: Body) -> Answer:
        """Ask for a plan."""
        self._asked += 1
        request_id = f"load-{id(self):x}-{self._asked}"
        content = json.dumps(body).encode()
        started = perf_counter()
        try:
            response = await self.connections.post(route, content, {"X-Request-ID": request_id})
        except NoAnswer as error:
            return Answer(route, 0, perf_counter() - started, False, "", str(error))
        latency = perf_counter() - started
        content_type = response.headers["content-type"]
        found: Any = json.loads(response.content) if "json" in content_type else response.content
        is_own = response.headers.get("x-request-id") == request_id and (
            response.status != httpx.codes.OK or found["seed"] == body["seed"]
        )
        return Answer(route, response.status, latency, is_own, content_type, found)

    async def metrics(self) -> Metrics:
        """Read the server's counts."""
        return Metrics((await self.http.get("/metrics")).raise_for_status().text)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.connections.close()
        await self.http.aclose()
