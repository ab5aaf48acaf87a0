"""`GET /metrics`: what Prometheus reads, and what moves it."""

from functools import partial

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from app.api.metrics import Metrics
from app.serving.admission import Pending
from tests.conftest import MODEL
from tests.metrics import value
from tests.served import wait_until

OURS = {
    "breakaway_requests": "counter",
    "breakaway_request_duration_seconds": "histogram",
    "breakaway_queue_seconds": "histogram",
    "breakaway_tick_seconds": "histogram",
    "breakaway_tick_rows": "histogram",
    "breakaway_pending_requests": "gauge",
    "breakaway_rows_waiting": "gauge",
    "breakaway_answer_bytes": "gauge",
    "breakaway_rejected": "counter",
}
OF_SESSIONS = {
    "breakaway_control_sessions": "gauge",
    "breakaway_control_session_duration_seconds": "histogram",
    "breakaway_control_step_seconds": "histogram",
    "breakaway_control_late_steps": "counter",
}
PLAN = {"initial_state": [0, 0], "target_state": [0.2, 0], "method": "uniform"}


def rendered(metrics: Metrics) -> str:
    return metrics.render({"tiny/1": Pending(2, 300, 5000)}, 0)[0].decode()


def test_all_names_are_ours_and_carry_the_model() -> None:
    metrics = Metrics()
    metrics.observe_request(route="/plan", http_method="POST", status=200, seconds=0.02)
    metrics.observe_queue("tiny/1", 0.01)
    metrics.observe_tick("tiny/1", rows=16, seconds=0.002)
    metrics.rejected("queue_full")
    metrics.observe_session(route="/control", status=101, seconds=3.0, controller="pid")
    metrics.observe_step("pid", 0.001, is_late=True)
    families = {
        family.name: family
        for family in text_string_to_metric_families(rendered(metrics))
        if not family.name.startswith(("process_", "python_"))
    }
    assert {name: family.type for name, family in families.items()} == OURS | OF_SESSIONS
    for name, family in families.items():
        assert family.documentation
        assert family.samples
        assert name in OF_SESSIONS or all(
            sample.labels["model"] in ("tiny/1", "none") for sample in family.samples
        )


def test_two_services_in_one_process_count_apart() -> None:
    one, other = Metrics(), Metrics()
    one.rejected("queue_full", "tiny/1")
    assert value(rendered(one), "breakaway_rejected_total", reason="queue_full") == 1
    assert value(rendered(other), "breakaway_rejected_total") == 0


def test_what_is_pending_is_told_as_it_is_now() -> None:
    metrics = Metrics()
    assert value(rendered(metrics), "breakaway_pending_requests", model="tiny/1") == 2
    assert value(rendered(metrics), "breakaway_rows_waiting", model="tiny/1") == 300
    assert value(rendered(metrics), "breakaway_answer_bytes", model="tiny/1") == 5000
    text = metrics.render({"other/1": Pending(1, 0)}, 3)[0].decode()
    assert value(text, "breakaway_control_sessions") == 3
    assert 'breakaway_pending_requests{model="tiny/1"}' not in text


def test_what_is_idle_is_told_as_zero(client: httpx.Client) -> None:
    def gauges() -> dict[tuple[str, str], float]:
        return {
            (sample.name, sample.labels["model"]): sample.value
            for family in text_string_to_metric_families(client.get("/metrics").text)
            for sample in family.samples
            if family.type == "gauge" and family.name in OURS
        }

    idle = {
        (f"breakaway_{name}", model): 0.0
        for name in ("pending_requests", "rows_waiting", "answer_bytes")
        for model in ("none", f"{MODEL}/1")
    }
    wait_until(lambda: gauges() == idle)


def test_a_tick_tells_rows_and_time() -> None:
    metrics = Metrics()
    metrics.observe_tick("tiny/1", rows=32, seconds=0.004)
    metrics.observe_tick("tiny/1", rows=64, seconds=0.006)
    text = rendered(metrics)
    assert value(text, "breakaway_tick_rows_sum", model="tiny/1") == 96
    assert value(text, "breakaway_tick_rows_bucket", le="32.0") == 1
    assert value(text, "breakaway_tick_seconds_sum") == pytest.approx(0.01)


def test_requests_are_counted_by_route_and_never_by_what_clients_write(
    client: httpx.Client,
) -> None:
    def counted(**labels: str) -> float:
        return value(client.get("/metrics").text, "breakaway_requests_total", **labels)

    def is_above(count: float, **labels: str) -> bool:
        return counted(**labels) > count

    asked = {
        "/livez": {"route": "/livez", "http_method": "GET", "status": "200", "model": "none"},
        "/no/such/path": {"route": "unmatched", "status": "404"},
        "/openapi.json": {"route": "/openapi.json", "status": "200"},
        "/static-offline-docs/swagger-ui.css": {"route": "/static-offline-docs", "status": "200"},
        "/static-offline-docs/nothing.css": {"route": "/static-offline-docs", "status": "404"},
    }
    for path, labels in asked.items():
        before = counted(**labels)
        client.get(path)
        # A file is closed, in a thread, when its answer is already here, and counted only then.
        wait_until(partial(is_above, before, **labels))
        assert counted(**labels) == before + 1
    client.post("/plan", json={})
    assert counted(route="/plan", http_method="POST", status="422", method="none") >= 1
    assert "/no/such/path" not in client.get("/metrics").text


@pytest.mark.parametrize("client", ["process"], indirect=True)  # Serve's proxy refuses them
def test_verbs_that_nobody_knows_are_counted_together(client: httpx.Client) -> None:
    client.request("BREW", "/livez")
    text = client.get("/metrics").text
    labels = {"route": "/livez", "http_method": "other", "status": "405"}
    assert value(text, "breakaway_requests_total", **labels) == 1
    assert "BREW" not in text


def test_how_long_requests_took_is_a_histogram_in_seconds(client: httpx.Client) -> None:
    assert client.post("/plan", json=PLAN).status_code == 200
    text = client.get("/metrics").text
    name = "breakaway_request_duration_seconds"
    count = value(text, f"{name}_count", route="/plan")
    assert count >= 1
    assert 0 < value(text, f"{name}_sum", route="/plan") < 60 * count
    assert value(text, f"{name}_bucket", route="/plan", le="60.0") <= count
    assert value(text, f"{name}_bucket", route="/plan", le="0.001") < count


def test_the_process_is_in_it_and_the_format_is_prometheus(client: httpx.Client) -> None:
    answer = client.get("/metrics")
    assert answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    for name in ("process_resident_memory_bytes", "python_info", "python_gc_collections_total"):
        assert value(answer.text, name) > 0
    documented = client.get("/openapi.json").json()["paths"]["/metrics"]["get"]["responses"]
    assert list(documented["200"]["content"]) == ["text/plain"]
