"""The compose file's Prometheus and Grafana: what they ask for is there."""

import json
import re
from pathlib import Path
from typing import Any

import yaml
from prometheus_client.metrics_core import Metric
from prometheus_client.parser import text_string_to_metric_families

from app.api.metrics import Metrics
from app.serving.admission import Pending
from tests.deploy.version import ROOT

DEPLOY = ROOT / "app" / "deploy"
SUFFIXES = {
    "counter": ("_total",),
    "histogram": ("_bucket", "_sum", "_count"),
    "gauge": ("",),
}
METRIC = re.compile(r"\b(?:breakaway|process|python)_\w+")


def compose() -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text())
    return read


def queries() -> list[str]:
    dashboard = json.loads((DEPLOY / "grafana" / "dashboard.json").read_text())
    return [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


def families() -> list[Metric]:
    """Return what `/metrics` shows."""
    text, _ = Metrics().render({"tiny/1": Pending(2, 300, 5000)}, 0)
    return list(text_string_to_metric_families(text.decode()))


def test_every_metric_of_the_dashboard_is_one_of_the_service() -> None:
    served = {
        family.name + suffix for family in families() for suffix in SUFFIXES.get(family.type, ())
    }
    asked = {metric for query in queries() for metric in METRIC.findall(query)}
    assert asked <= served
    assert len(asked) > 10


def test_the_dashboard_shows_what_the_service_counts_of_its_work() -> None:
    ours = {family.name for family in families() if family.name.startswith("breakaway_")}
    everything = " ".join(queries())
    missing = {name for name in ours if name not in everything}
    assert missing == {"breakaway_control_session_duration_seconds"}  # of those that are over


def test_every_file_that_is_mounted_is_there() -> None:
    mounted = [
        volume.split(":")[0]
        for service in compose()["services"].values()
        for volume in service.get("volumes", ())
        if volume.startswith("./")
    ]
    assert mounted
    assert all((ROOT / Path(path)).is_file() for path in mounted)


def test_prometheus_and_grafana_find_each_other_and_the_service() -> None:
    services = compose()["services"]
    (job,) = yaml.safe_load((DEPLOY / "prometheus.yaml").read_text())["scrape_configs"]
    (source,) = yaml.safe_load((DEPLOY / "grafana" / "source.yaml").read_text())["datasources"]
    dashboard = json.loads((DEPLOY / "grafana" / "dashboard.json").read_text())

    hosts = [job["static_configs"][0]["targets"][0], source["url"].removeprefix("http://")]
    assert [host.split(":")[0] for host in hosts] == ["breakaway", "prometheus"]
    assert all(host.split(":")[0] in services for host in hosts)
    assert {panel["datasource"]["uid"] for panel in dashboard["panels"]} == {source["uid"]}
    assert f'job="{job["job_name"]}"' in " ".join(queries())
