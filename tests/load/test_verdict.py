import math

import pytest
from click.testing import CliRunner

from app.launch import free_port
from tests.load.__main__ import load
from tests.load.client import Metrics
from tests.load.verdict import Verdict, percentile


def test_a_verdict_names_what_failed() -> None:
    verdict = Verdict("a run")
    verdict.check("exactly as much as it may be", 50.0, 50.0, "MB")
    assert verdict.passed
    verdict.check("too much", 50.1, 50.0, "MB")
    verdict.check("never measured", math.nan, 1.0)
    assert not verdict.passed
    assert verdict.failures == ["too much", "never measured"]


def test_percentiles() -> None:
    values = [float(value) for value in range(100, 0, -1)]
    assert percentile(values, 0.5) == 51.0
    assert percentile(values, 0.99) == 100.0
    assert math.isnan(percentile([], 0.5))


def test_metrics_are_summed_by_label() -> None:
    metrics = Metrics(
        "# TYPE breakaway_requests_total counter\n"
        'breakaway_requests_total{route="/plan",http_method="POST",status="200",model="a"} 2\n'
        'breakaway_requests_total{route="/plan",http_method="POST",status="200",model="b"} 3\n'
        'breakaway_requests_total{route="/plan",http_method="GET",status="405",model=""} 1\n'
        'breakaway_requests_total{route="/livez",http_method="GET",status="200",model=""} 7\n'
    )
    assert metrics.answered == {("/plan", 200): 5}
    assert metrics.by("breakaway_requests_total", "status") == {"200": 12, "405": 1}
    assert metrics.total("breakaway_requests_total", route="/livez") == 7
    with pytest.raises(KeyError):
        metrics.total("breakaway_request_total")


def test_a_missing_service_is_said() -> None:
    url = f"http://127.0.0.1:{free_port()}"
    done = CliRunner().invoke(load, ["overload", "--url", url])
    assert done.exit_code == 2
    assert "no service is ready" in done.output
