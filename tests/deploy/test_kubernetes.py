"""The manifests for Kubernetes, against the schemas of Kubernetes and of Ray."""

from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

import app
from tests.deploy.version import VERSION

FOLDER = Path(app.__file__).parent / "deploy" / "kubernetes"
KUBERNETES = "1.33"
"""The oldest version that its makers still mend."""


def documents(name: str) -> list[dict[str, Any]]:
    return list(yaml.safe_load_all((FOLDER / name).read_text()))


def of_kind(kind: str) -> dict[str, Any]:
    (found,) = (one for one in documents("replicas.yaml") if one["kind"] == kind)
    return found


def pods_of_ray() -> list[dict[str, Any]]:
    (service,) = documents("rayservice.yaml")
    cluster = service["spec"]["rayClusterConfig"]
    groups = [cluster["headGroupSpec"], *cluster["workerGroupSpecs"]]
    return [group["template"] for group in groups]


def pods() -> list[dict[str, Any]]:
    return [of_kind("Deployment")["spec"]["template"], *pods_of_ray()]


@pytest.mark.parametrize(
    "document", documents("replicas.yaml"), ids=lambda document: document["kind"]
)
def test_kubernetes_takes_what_plain_replicas_are_made_of(document: dict[str, Any]) -> None:
    kubernetes_validate.validate(document, KUBERNETES, strict=True)


@pytest.mark.parametrize("pod", pods_of_ray(), ids=["head", "worker"])
def test_kubernetes_takes_the_pods_of_ray(pod: dict[str, Any]) -> None:
    whole = {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "ray"}, **pod}
    kubernetes_validate.validate(whole, KUBERNETES, strict=True)


def test_ray_serve_takes_its_configuration() -> None:
    schema = pytest.importorskip("ray.serve.schema")
    (service,) = documents("rayservice.yaml")
    config = schema.ServeDeploySchema(**yaml.safe_load(service["spec"]["serveConfigV2"]))
    assert [one.import_path for one in config.applications] == ["app.deploy.ray:application"]


def test_what_refers_to_each_other_agrees() -> None:
    deployment, service = of_kind("Deployment"), of_kind("Service")
    labels = deployment["spec"]["template"]["metadata"]["labels"]
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    ports = {port["name"]: port["containerPort"] for port in container["ports"]}

    assert deployment["spec"]["selector"]["matchLabels"] == labels
    assert service["spec"]["selector"] == labels
    assert of_kind("PodDisruptionBudget")["spec"]["selector"]["matchLabels"] == labels
    target = of_kind("HorizontalPodAutoscaler")["spec"]["scaleTargetRef"]
    assert (target["kind"], target["name"]) == ("Deployment", deployment["metadata"]["name"])
    assert ports[service["spec"]["ports"][0]["targetPort"]] == 8000


def test_a_pod_runs_this_version_and_may_do_no_more_than_it_needs() -> None:
    for pod in pods():
        assert pod["spec"]["securityContext"]["runAsNonRoot"]
        for container in pod["spec"]["containers"]:
            assert container["image"].split("-")[0] == f"breakaway:{VERSION}"
            assert not container["securityContext"]["allowPrivilegeEscalation"]
            assert container["securityContext"]["capabilities"]["drop"] == ["ALL"]


def test_a_pod_is_given_the_time_that_its_longest_request_may_take() -> None:
    from app.server import SENDING_SECONDS
    from app.settings import Settings

    pod = of_kind("Deployment")["spec"]["template"]["spec"]
    pause = pod["containers"][0]["lifecycle"]["preStop"]["sleep"]["seconds"]
    least = pause + Settings().max_deadline_ms / 1e3 + SENDING_SECONDS
    assert pod["terminationGracePeriodSeconds"] >= least
